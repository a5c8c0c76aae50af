#include <gtest/gtest.h>

#include "client/cli/common.h"
#include "client/cli/job_progress.h"
#include "client/cli/progress_line.h"

namespace depthtween::cli {
namespace {

TEST(FormatBytes, UsesPowersOfThousand) {
  EXPECT_EQ(FormatBytes(999), "999 B");
  EXPECT_EQ(FormatBytes(1000), "1.0 kB");
  EXPECT_EQ(FormatBytes(999'960), "1.0 MB");
  EXPECT_EQ(FormatBytes(20'000'000'000), "20.0 GB");
}

TEST(FormatDuration, ReadsLikeAClock) {
  EXPECT_EQ(FormatDuration(6.6), "0:07");
  EXPECT_EQ(FormatDuration(3723), "1:02:03");
}

// 100 % is for what is done: 0.999 must not be rounded up to it.
TEST(FormatProgressLine, NeverClaimsMoreThanIsDone) {
  EXPECT_EQ(FormatProgressLine("upload", 0.5, "1 of 2", 80), "[============>           ]  50 %  upload  1 of 2");
  EXPECT_NE(FormatProgressLine("upload", 0.999, "", 80).find(" 99 %"), std::string::npos);
  EXPECT_NE(FormatProgressLine("upload", 1.0, "", 80).find("100 %"), std::string::npos);
  EXPECT_EQ(FormatProgressLine("upload", 0.5, "1 of 2", 10).size(), 10U);
}

TEST(JobName, TakesNameOrId) {
  EXPECT_EQ(*JobName("jobs/7"), "jobs/7");
  EXPECT_EQ(*JobName("7"), "jobs/7");
  EXPECT_TRUE(absl::IsInvalidArgument(JobName("sequences/7").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(JobName("jobs/").status()));
}

TEST(DescribeProgress, SaysWhatWasMeasuredAndNoMore) {
  v1::Job job;
  job.set_state(v1::Job::STATE_QUEUED);
  EXPECT_EQ(DescribeProgress(job), "queued");
  job.mutable_progress()->set_queue_position(2);
  EXPECT_EQ(DescribeProgress(job), "queued, 2 jobs ahead");
  job.set_state(v1::Job::STATE_RUNNING);
  job.mutable_progress()->set_stage("prepare");
  EXPECT_EQ(DescribeProgress(job), "prepare");
  job.mutable_progress()->set_stage("flow");
  job.mutable_progress()->set_frames_done(17);
  job.mutable_progress()->set_frames_total(66);
  job.mutable_progress()->set_intervals_done(2);
  job.mutable_progress()->set_intervals_total(8);
  EXPECT_EQ(DescribeProgress(job), "frame 17 of 66, interval 2 of 8, flow");
  job.mutable_progress()->mutable_eta()->mutable_remaining()->set_seconds(4);
  EXPECT_EQ(DescribeProgress(job), "frame 17 of 66, interval 2 of 8, flow, 0:04 left");
  job.set_state(v1::Job::STATE_SUCCEEDED);
  EXPECT_EQ(DescribeProgress(job), "succeeded, 17 frames");
}

}  // namespace
}  // namespace depthtween::cli
