// Upkeep with spans of time that have passed, or never do: what must be gone and what must stay follows from them.
#include "server/jobs/upkeep.h"

#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

class UpkeepTest : public JobsFixture {
 protected:
  std::unique_ptr<Upkeep> Keep(const UpkeepOptions& options, const RetentionRules& rules = {}) {
    collector_ = std::make_unique<Collector>(*store_, *jobs_, *sequences_, *directory_, rules);
    return std::make_unique<Upkeep>(*store_, *collector_, jobs_->damage(), directory_->path(), options);
  }
  std::unique_ptr<Collector> collector_;
};

TEST_F(UpkeepTest, WhatMayGoGoesByItself) {
  Start();
  const std::string job = NewJobOn(ReadySequence());
  Ended(job);
  const auto upkeep = Keep({.scrub_round = absl::ZeroDuration(), .gap = absl::Milliseconds(1)},
                           {.keep_succeeded = absl::Microseconds(1)});
  WaitUntil([&] { return !jobs_->Get(kTenant, job).ok(); });
  WaitUntil([&] { return !std::filesystem::exists(directory_->JobFolder(job)); });
}

TEST_F(UpkeepTest, ARoundBeginsWhenItIsAskedFor) {
  Start();
  const std::string job = NewJobOn(ReadySequence("intervals 2\n"));
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded);
  const auto upkeep = Keep({.scrub_round = absl::ZeroDuration()});
  EXPECT_FALSE(Take(upkeep->GetScrub()).running);
  EXPECT_EQ(Take(upkeep->GetScrub()).start_time, absl::InfinitePast());
  const absl::Time before = absl::Now();
  WriteText(directory_->OutFolder(job) + "/depth/000001.png", "depth 2");  // as long as it was
  upkeep->StartScrub();
  EXPECT_TRUE(Take(upkeep->GetScrub()).running);
  WaitUntil([&] { return !Take(upkeep->GetScrub()).running; });
  const ScrubState found = Take(upkeep->GetScrub());
  EXPECT_GE(found.start_time, absl::FromUnixMicros(absl::ToUnixMicros(before)));
  EXPECT_GT(found.files_checked, 4);
  EXPECT_EQ(found.damaged_files, 1);
}

TEST_F(UpkeepTest, DamageIsFoundInTheBackgroundAndARoundGoesOnAfterAStop) {
  Start();
  const std::string sequence = ReadySequence("intervals 2\n"), job = NewJobOn(sequence);
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded);
  WriteText(directory_->OutFolder(job) + "/depth/000001.png", "depth 2");  // as long as it was
  // A round that an earlier server began, and that has come to the job's files.
  EXPECT_THAT(store_->SetScrub({.start_time = absl::Now(), .cursor = "j 0 ", .over = false}), IsOk());
  const auto upkeep = Keep({.scrub_round = absl::Hours(1), .gap = absl::Milliseconds(1)});
  WaitUntil([&] { return Take(store_->GetScrub()).over; });
  EXPECT_EQ(jobs_->damage().files(), 1);
}

}  // namespace
}  // namespace depthtween::server
