// A collector with spans of time that have passed, or never do: what must be gone and what must stay follows from them.
#include "server/jobs/collector.h"

#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

using testing::IsEmpty;
using testing::SizeIs;

class CollectorTest : public JobsFixture {
 protected:
  // One that was begun and got `bytes` of its 100.
  std::string Begun(int64_t bytes) {
    const std::string id = Take(sequences_->Create(kTenant, "", "")).id;
    const UploadRecord upload = Take(sequences_->StartUpload(kTenant, id, {{.path = "a", .size_bytes = 100}}, ""));
    const std::string sent(static_cast<size_t>(bytes), 'x');
    const auto writer = Take(sequences_->OpenUpload(kTenant, id, upload.id));
    EXPECT_THAT(writer->Write(0, sent, Crc32c(sent)), IsOk());
    EXPECT_THAT(writer->Close(), IsOk());
    return id;
  }
  std::vector<Collected> Collect(const RetentionRules& rules, bool dry_run = false) {
    return Take(Collector(*store_, *jobs_, *sequences_, *directory_, rules).Collect(dry_run));
  }
  bool Exists(const std::string& id) { return sequences_->Get(kTenant, id).ok(); }
};

TEST_F(CollectorTest, UploadsThatWereGivenUpGo) {
  Start();
  const std::string committed = ReadySequence(), abandoned = Begun(10);
  EXPECT_THAT(Collect({.keep_uploads = absl::Hours(1)}), IsEmpty());
  EXPECT_THAT(Collect({}), IsEmpty());
  const RetentionRules rules = {.keep_uploads = absl::Microseconds(1)};
  EXPECT_THAT(Collect(rules, /*dry_run=*/true), SizeIs(1));
  EXPECT_TRUE(Exists(abandoned)) << "a dry run deletes nothing";
  const std::vector<Collected> collected = Collect(rules);
  ASSERT_THAT(collected, SizeIs(1));
  EXPECT_EQ(collected[0].resource, "sequences/" + abandoned);
  EXPECT_EQ(collected[0].reason, CollectReason::kAbandoned);
  EXPECT_FALSE(Exists(abandoned));
  EXPECT_FALSE(std::filesystem::exists(directory_->SequenceFolder(abandoned)));
  EXPECT_TRUE(Exists(committed)) << "committed recordings stay";
}

// By the times that the store keeps: only bytes count, and the look and the deletion are not one moment.
TEST_F(CollectorTest, ABytePutsTheEndOff) {
  Start();
  const std::string first = Begun(10);
  const absl::Time between = absl::Now();
  const std::string second = Begun(10);
  const std::vector<Collectable> abandoned = Take(store_->AbandonedSequences(between));
  ASSERT_THAT(abandoned, SizeIs(1));
  EXPECT_EQ(abandoned[0].id, first);
  const auto writer = Take(sequences_->OpenUpload(
      kTenant, first, Take(sequences_->StartUpload(kTenant, first, {{.path = "b", .size_bytes = 1}}, "")).id));
  EXPECT_THAT(sequences_->RemoveAbandoned(abandoned[0]), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_TRUE(Exists(first));
  EXPECT_TRUE(Exists(second));
}

TEST_F(CollectorTest, JobsThatEndedLongAgoGoWithTheirFilesAndPinnedOnesStay) {
  Start();
  const std::string sequence = ReadySequence();
  const std::string job = NewJobOn(sequence), pinned = NewJobOn(sequence);
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded);
  ASSERT_EQ(Ended(pinned).record.state, JobState::kSucceeded);
  EXPECT_TRUE(Take(jobs_->Pin(kTenant, pinned, true)).record.pinned);
  EXPECT_THAT(Collect({.keep_succeeded = absl::Hours(1), .keep_failed = absl::Microseconds(1)}), IsEmpty());
  const std::vector<Collected> collected = Collect({.keep_succeeded = absl::Microseconds(1)});
  ASSERT_THAT(collected, SizeIs(1));
  EXPECT_EQ(collected[0].resource, "jobs/" + job);
  EXPECT_EQ(collected[0].tenant, kTenant.name());
  EXPECT_GT(collected[0].bytes, 0);
  EXPECT_THAT(jobs_->Get(kTenant, job), HasCode(absl::StatusCode::kNotFound));
  EXPECT_FALSE(std::filesystem::exists(directory_->JobFolder(job)));
  EXPECT_EQ(State(pinned), JobState::kSucceeded);
  EXPECT_TRUE(std::filesystem::exists(directory_->JobFolder(pinned)));

  // The recording goes once nothing unfinished needs it.
  EXPECT_THAT(Collect({.keep_sequences = absl::Microseconds(1)}), SizeIs(1));
  EXPECT_FALSE(Exists(sequence));
}

// Watchers learn that it is gone.
TEST_F(CollectorTest, AWatchedJobIsCollectedToo) {
  Start();
  const std::string job = NewJobOn(ReadySequence());
  Ended(job);
  const auto watch = Take(jobs_->Watch(kTenant, job, "", nullptr));
  EXPECT_THAT(Collect({.keep_succeeded = absl::Microseconds(1)}), SizeIs(1));
  EXPECT_TRUE(watch->Deleted());
}

}  // namespace
}  // namespace depthtween::server
