// Upkeep with spans of time that have passed, or never do: what must be gone and what must stay follows from them.
#include "server/jobs/upkeep.h"

#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

class UpkeepTest : public JobsFixture {
 protected:
  std::string Begun(int64_t bytes) {
    const std::string id = Take(sequences_->Create(kTenant, "", "")).id;
    const UploadRecord upload = Take(sequences_->StartUpload(kTenant, id, {{.path = "a", .size_bytes = 100}}, ""));
    const std::string sent(static_cast<size_t>(bytes), 'x');
    const auto writer = Take(sequences_->OpenUpload(kTenant, id, upload.id));
    EXPECT_THAT(writer->Write(0, sent, Crc32c(sent)), IsOk());
    EXPECT_THAT(writer->Close(), IsOk());
    return id;
  }
  bool Exists(const std::string& id) { return sequences_->Get(kTenant, id).ok(); }
};

TEST_F(UpkeepTest, UploadsThatWereGivenUpAreRemoved) {
  Start();
  const std::string committed = ReadySequence(), abandoned = Begun(10);
  {
    const Upkeep patient(*store_, *sequences_, jobs_->damage(), directory_->path(),
                         {.keep_uploads = absl::Hours(1), .scrub_round = absl::ZeroDuration()});
    const Upkeep never(*store_, *sequences_, jobs_->damage(), directory_->path(),
                       {.keep_uploads = absl::ZeroDuration(), .scrub_round = absl::ZeroDuration()});
  }
  EXPECT_TRUE(Exists(abandoned));
  const Upkeep upkeep(
      *store_, *sequences_, jobs_->damage(), directory_->path(),
      {.keep_uploads = absl::Microseconds(1), .scrub_round = absl::ZeroDuration(), .gap = absl::Milliseconds(1)});
  WaitUntil([&] { return !Exists(abandoned); });
  WaitUntil([&] { return !std::filesystem::exists(directory_->SequenceFolder(abandoned)); });
  EXPECT_TRUE(Exists(committed)) << "committed recordings stay";
}

// By the times that the store keeps: only bytes count, and the look and the deletion are not one moment.
TEST_F(UpkeepTest, ABytePutsTheEndOff) {
  Start();
  const std::string first = Begun(10);
  const absl::Time between = absl::Now();
  const std::string second = Begun(10);
  EXPECT_THAT(Take(store_->AbandonedSequences(between)), testing::ElementsAre(first));
  EXPECT_THAT(store_->DeleteAbandonedSequence(second, between), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Take(sequences_->RemoveAbandoned(between)), testing::ElementsAre(first));
  EXPECT_TRUE(Exists(second));
  EXPECT_FALSE(Exists(first));
}

TEST_F(UpkeepTest, DamageIsFoundInTheBackgroundAndARoundGoesOnAfterAStop) {
  Start();
  const std::string sequence = ReadySequence("intervals 2\n"), job = NewJobOn(sequence);
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded);
  WriteText(directory_->OutFolder(job) + "/depth/000001.png", "depth 2");  // as long as it was
  // A round that an earlier server began, and that has come to the job's files.
  EXPECT_THAT(store_->SetScrub({.start_time = absl::Now(), .cursor = "j 0 ", .over = false}), IsOk());
  const auto upkeep = std::make_unique<Upkeep>(
      *store_, *sequences_, jobs_->damage(), directory_->path(),
      UpkeepOptions{.keep_uploads = absl::ZeroDuration(), .scrub_round = absl::Hours(1), .gap = absl::Milliseconds(1)});
  WaitUntil([&] { return Take(store_->GetScrub()).over; });
  EXPECT_EQ(jobs_->damage().files(), 1);
}

}  // namespace
}  // namespace depthtween::server
