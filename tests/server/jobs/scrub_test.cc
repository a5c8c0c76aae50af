// Damage is what the test does to files that a server stores and has open; what is whole must not be reported.
#include "server/jobs/scrub.h"

#include <algorithm>

#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class ScrubTest : public JobsFixture {
 protected:
  ScrubTest() {
    Start();
    sequence_ = ReadySequence("intervals 2\nmoves\n");
    job_ =
        Take(jobs_->Create(kTenant,
                           {.sequence_id = sequence_, .renders = {{.options = R"({"name":"dof","container":"mp4"})"}}},
                           "", false))
            .record.id;
    EXPECT_EQ(Ended(job_).record.state, JobState::kSucceeded);
  }
  std::string Data(const std::string& file) const { return folder_ / ("data/" + file); }
  void FlipBit(const std::string& file) {
    std::string bytes = ReadText(Data(file));
    ASSERT_FALSE(bytes.empty()) << file;
    bytes.back() = static_cast<char>(bytes.back() ^ 1);
    WriteText(Data(file), bytes);
  }
  static std::vector<std::string> Faults(const ScrubSummary& summary) {
    std::vector<std::string> paths;
    for (const FileFault& fault : summary.faults) paths.push_back(fault.path);
    std::sort(paths.begin(), paths.end());
    return paths;
  }

  std::string sequence_, job_;
};

TEST_F(ScrubTest, FindsEachDamagedFileBesideARunningServer) {
  const ScrubSummary whole = Take(ScrubFolder(Data("")));
  EXPECT_THAT(Faults(whole), IsEmpty());
  // The script; constants; of 4 frames depth, uncertainty, provenance, motion and picture; 2 reports of intervals and 2
  // of pictures; report, video, depth.txt and camera.json.
  EXPECT_EQ(whole.files, 1 + 1 + 4 * 5 + 4 + 4);
  EXPECT_EQ(whole.unknown_files, 0);
  EXPECT_EQ(whole.bytes, Take(store_->StoredBytes()));

  const std::string script = "sequences/" + sequence_ + "/script", out = "jobs/" + job_ + "/out/";
  std::vector<std::string> damaged = {out + "depth/000001.png", out + "dof.mp4", out + "motion/000002.npz",
                                      out + "report.json", script};
  for (const std::string& file : damaged) FlipBit(file);
  std::filesystem::remove(Data(out + "camera.json"));
  damaged.insert(damaged.begin(), out + "camera.json");
  EXPECT_THAT(Faults(Take(ScrubFolder(Data("")))), testing::ElementsAreArray(damaged));

  // File by file it is the same, and it ends.
  ScrubSummary one_by_one;
  std::string cursor;
  int steps = 0;
  do {
    cursor = Take(ScrubSome(*store_, directory_->path(), cursor, 1, 0, {}, one_by_one));
    ++steps;
  } while (!cursor.empty());
  EXPECT_THAT(Faults(one_by_one), testing::ElementsAreArray(damaged));
  EXPECT_EQ(one_by_one.files, whole.files);
  EXPECT_EQ(steps, whole.files + 1) << "the last step finds that there is no more";
}

TEST_F(ScrubTest, WhatIsDeletedIsNoFault) {
  EXPECT_THAT(jobs_->Delete(kTenant, job_), IsOk());
  const ScrubSummary left = Take(ScrubFolder(Data("")));
  EXPECT_EQ(left.files, 1);
  EXPECT_THAT(Faults(left), IsEmpty());
  EXPECT_THAT(sequences_->Delete(kTenant, sequence_), IsOk());
  EXPECT_EQ(Take(ScrubFolder(Data(""))).files, 0);
}

TEST_F(ScrubTest, StopsWhenTold) {
  std::stop_source stop;
  stop.request_stop();
  ScrubSummary summary;
  EXPECT_THAT(ScrubSome(*store_, directory_->path(), "", 10, /*bytes_per_second=*/1, stop.get_token(), summary),
              HasCode(absl::StatusCode::kCancelled));
}

TEST_F(ScrubTest, NeedsADataFolder) {
  EXPECT_THAT(ScrubFolder(folder_ / "none"), HasCode(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace depthtween::server
