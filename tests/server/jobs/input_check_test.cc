// The test itself flips a bit of a file that is about to be read. The work that needs it must fail and name it, and
// other work must not.
#include "server/jobs/input_check.h"

#include "server/jobs/task_runner.h"
#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

class InputCheckTest : public JobsFixture {
 protected:
  // Flips one bit of a file of the data folder. Doing it twice is as good as never.
  void FlipBit(const std::string& file) {
    const std::string path = folder_ / ("data/" + file);
    std::string bytes = ReadText(path);
    ASSERT_FALSE(bytes.empty()) << path;
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 4);
    WriteText(path, bytes);
  }
  // It names the file, and no folder of the server's.
  void ExpectDamaged(const absl::Status& status, const std::string& file) {
    EXPECT_THAT(status, HasReason(absl::StatusCode::kDataLoss, "FILE_DAMAGED"));
    EXPECT_THAT(std::string(status.message()), HasSubstr(file));
    EXPECT_EQ(std::string(status.message()).find(folder_.path()), std::string::npos);
    const auto info = GetErrorInfo(status);
    EXPECT_EQ(info ? info->metadata.at("file") : "", file);
  }
};

TEST_F(InputCheckTest, ADamagedRecordingFailsItsValidationAndEachNewJob) {
  Start();
  const std::string sequence = ReadySequence("intervals 2\n"), script = "sequences/" + sequence + "/script";
  FlipBit(script);
  const JobRecord failed = Ended(NewJobOn(sequence)).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  ExpectDamaged(failed.error, script);
  EXPECT_THAT(Logged(sequence, "start"), IsEmpty()) << "nothing was computed from it";
  EXPECT_EQ(jobs_->damage().files(), 1);
  FlipBit(script);
  EXPECT_EQ(Ended(NewJobOn(sequence)).record.state, JobState::kSucceeded);

  // Between the upload and the commit.
  const std::string id = Take(sequences_->Create(kTenant, "", "")).id;
  const UploadRecord upload = Take(sequences_->StartUpload(kTenant, id, {{.path = "a", .size_bytes = 3}}, ""));
  EXPECT_THAT(Take(sequences_->OpenUpload(kTenant, id, upload.id))->Write(0, "abc", Crc32c("abc")), IsOk());
  EXPECT_THAT(Take(sequences_->OpenUpload(kTenant, id, upload.id))->Finish(), IsOk());
  FlipBit("sequences/" + id + "/a");
  EXPECT_THAT(sequences_->Commit(kTenant, id), IsOk());
  const SequenceRecord invalid = Validated(id);
  EXPECT_EQ(invalid.state, SequenceState::kInvalid);
  EXPECT_THAT(invalid.validation.error, HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(std::string(invalid.validation.error.message()), HasSubstr("the bytes of sequences/" + id + "/a"));
}

TEST_F(InputCheckTest, DamagedConstantsAndReportsFailTheJob) {
  Start();
  const std::string sequence = ReadySequence("wait_at 2\n");
  const auto stopped_at_2 = [&] {
    const std::string job = NewJobOn(sequence);
    WaitUntil([&] { return View(job).record.intervals_done == 2; });
    jobs_.reset();
    return job;
  };
  const std::string first = stopped_at_2();
  FlipBit("jobs/" + first + "/constants.json");
  StartJobs();
  EXPECT_EQ(Ended(first).record.state, JobState::kFailed);
  ExpectDamaged(View(first).record.error, "jobs/" + first + "/constants.json");

  const std::string second = stopped_at_2();
  FlipBit("jobs/" + second + "/out/interval_000001.json");
  Go(sequence);
  StartJobs();
  EXPECT_EQ(Ended(second).record.state, JobState::kFailed);
  EXPECT_EQ(View(second).record.intervals_done, 3) << "what does not read it is computed";
  ExpectDamaged(View(second).record.error, "jobs/" + second + "/out/interval_000001.json");
}

TEST_F(InputCheckTest, NoPictureIsMadeOfDamagedDepth) {
  Start();
  const std::string sequence = ReadySequence(), job = NewJobOn(sequence);
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded);
  const auto render = [&](int frame) {
    return jobs_->RenderFrame(kTenant, job, {.frame = frame, .options = R"({"name":"x"})"}, nullptr).status();
  };
  FlipBit("jobs/" + job + "/out/depth/000003.png");
  EXPECT_THAT(render(2), IsOk());
  ExpectDamaged(render(3), "jobs/" + job + "/out/depth/000003.png");

  // A job that takes the depth over takes its checksum over, too, and looks one frame around each interval.
  const std::string pictures =
      Take(jobs_->Create(kTenant,
                         {.sequence_id = sequence, .renders = {{.options = R"({"name":"dof"})"}}, .depth_from = job},
                         "", false))
          .record.id;
  EXPECT_EQ(Ended(pictures).record.state, JobState::kFailed);
  ExpectDamaged(View(pictures).record.error, "jobs/" + pictures + "/out/depth/000003.png");
  EXPECT_THAT(Logged(sequence, "render"), testing::ElementsAre(0)) << "frames 0 to 2 are as they were";
}

// A task that is stopped while its files are being checked has not failed.
TEST_F(InputCheckTest, BeingStoppedIsNoFailure) {
  Start();
  const std::string sequence = ReadySequence();
  jobs_.reset();
  const std::string job = Take(store_->CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
  const Task task = Take(store_->ClaimTask([](const JobRecord&, TaskKind) { return 1; })).value();
  DamageLog damage;
  TaskRunner runner(*directory_, *store_, damage, {.core_program = FAKE_CORE});
  std::stop_source stop;
  stop.request_stop();
  const TaskOutcome outcome = runner.Run(task, Take(store_->GetJob(kTenant, job)), stop.get_token(), {});
  EXPECT_TRUE(outcome.stopped);
  EXPECT_THAT(outcome.error, HasCode(absl::StatusCode::kCancelled));
  EXPECT_EQ(damage.files(), 0);
}

}  // namespace
}  // namespace depthtween::server
