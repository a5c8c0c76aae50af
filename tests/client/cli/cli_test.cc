// What the client prints. Texts are written by hand from the messages they tell of.
#include <gtest/gtest.h>

#include "client/cli/common.h"
#include "client/cli/job_progress.h"
#include "client/cli/lost_files.h"
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
  job.mutable_scene_flow_options();
  EXPECT_EQ(DescribeProgress(job), "succeeded, 17 pairs of frames");
  job.set_state(v1::Job::STATE_RUNNING);
  job.mutable_progress()->clear_eta();
  EXPECT_EQ(DescribeProgress(job), "pair 17 of 66, flow");
}

TEST(DescribeFailure, SaysWhyAndNothingToTheTerminal) {
  v1::Job job;
  EXPECT_EQ(DescribeFailure(job), "");
  job.set_state(v1::Job::STATE_FAILED);
  job.mutable_error()->set_code(static_cast<int>(absl::StatusCode::kDataLoss));
  job.mutable_error()->set_message("a\nb\x1b[2J");
  EXPECT_EQ(DescribeFailure(job), "it failed: a\nb?[2J (DATA_LOSS)\n");
}

// A server's words are shown, its control characters are not.
TEST(Report, KeepsControlCharactersFromTheTerminal) {
  testing::internal::CaptureStderr();
  EXPECT_EQ(Report(absl::DataLossError("one\ntwo\x1b]0;title\x07")), 1);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "depthtween: one\ntwo?]0;title?\n");
}

// What one would have to type to ask for the same; nothing for what is the default.
TEST(DescribeOptions, AreTheFlagsOfTheOrder) {
  v1::Job job;
  EXPECT_EQ(DescribeOptions(job), "");
  v1::UpsampleOptions& options = *job.mutable_options();
  options.set_method("ours");
  options.set_key_every(1);
  options.set_preset("balanced");
  options.set_clock("stamps");
  EXPECT_EQ(DescribeOptions(job), "");
  options.set_preset("reference");
  options.add_literal("short");
  options.add_literal("rigid\x1b");
  options.add_without("median");
  options.set_clock("-4");
  options.set_self_check(true);
  EXPECT_EQ(DescribeOptions(job),
            "asked for: --preset reference --self-check --clock=-4 --without median --literal short,rigid?\n");
  options.Clear();
  options.set_method("dolson-mode");
  options.set_key_every(4);
  EXPECT_EQ(DescribeOptions(job), "asked for: --method dolson-mode --key-every 4\n");
  v1::SceneFlowOptions& flow = *job.mutable_scene_flow_options();
  flow.add_formats("npz");
  EXPECT_EQ(DescribeOptions(job), "");
  flow.set_method("pd-flow");
  flow.add_formats("kitti");
  flow.set_every(2);
  EXPECT_EQ(DescribeOptions(job), "asked for: --method pd-flow --format npz,kitti --every 2\n");
}

TEST(DescribeLost, SaysHowManyWhichAndWhatToDo) {
  EXPECT_EQ(DescribeLost("jobs/7", {{.output = "jobs/7/outputs/report", .place = "report.json"}}, "out"),
            "jobs/7: report.json is lost or damaged on the server's disk; everything else that is ready is in out. To "
            "recreate "
            "it, run 'depthtween delete jobs/7' and submit again");
  const std::vector<client::LostOutput> lost = {
      {.output = "jobs/7/outputs/depth", .place = "depth", .frames = {3, 8, 9, 10}},
      {.output = "jobs/7/outputs/dof", .place = "dof\x1b", .frames = {0}},
      {.output = "jobs/7/outputs/report", .place = "report.json"}};
  EXPECT_EQ(
      DescribeLost("jobs/7", lost, "out"),
      "jobs/7: 4 frames of depth (3, 8-10), 1 frame of dof? (0) and report.json are lost or damaged on the server's "
      "disk; "
      "everything else that is ready is in out. To recreate them, run 'depthtween delete jobs/7' and submit again");
  EXPECT_EQ(LostToJson(lost).dump(),
            R"([{"frames":[3,8,9,10],"output":"jobs/7/outputs/depth"},{"frames":[0],"output":"jobs/7/outputs/dof"},)"
            R"({"output":"jobs/7/outputs/report"}])");
}

// A line for people ends; --json has the rest.
TEST(DescribeLost, CutsALongList) {
  client::LostOutput lost = {.output = "jobs/7/outputs/depth", .place = "depth"};
  for (int i = 0; i < 40; i += 2) lost.frames.push_back(i);
  EXPECT_NE(DescribeLost("jobs/7", {lost}, "out").find("20 frames of depth (0, 2, 4, 6, 8, 10, 12, 14, and 12 more)"),
            std::string::npos);
}

// The columns are those of `depthtween-core upsample --self-check`; control characters of a server's text are not
// shown.
TEST(DescribeMeasured, SelfCheckIsASmallTable) {
  v1::Job job;
  EXPECT_EQ(DescribeMeasured(job), "");
  v1::SelfCheck& check = *job.mutable_self_check();
  check.set_summary("no self-check:\x1b too short");
  check.set_reason("too short");
  EXPECT_EQ(DescribeMeasured(job), "no self-check:? too short\n");
  check.set_summary("on your clip it errs by 7.1 mm");
  check.clear_reason();
  check.set_maps_checked(12);
  check.set_maps_held_out(40);
  v1::SelfCheck::Method* method = check.add_methods();
  method->set_name("ours");
  method->set_rmse_mm(7.06);
  method->set_mae_mm(1.5);
  method->set_edge_band_rmse_mm(20.25);
  method->set_completeness(0.995);
  method->set_within_one_sigma(0.7);
  method = check.add_methods();
  method->set_name("hold");
  method->set_rmse_mm(70);
  method->set_completeness(1);
  v1::SelfCheck::Frame* frame = check.add_worst_frames();
  frame->set_stem("000017");
  frame->set_rmse_mm(9);
  EXPECT_EQ(DescribeMeasured(job),
            "on your clip it errs by 7.1 mm\n"
            "\n"
            "self-check   RMSE mm    MAE mm   edge band   complete  <1 sigma   (12 of 40 held-out depth maps)\n"
            "ours             7.1       1.5        20.2     99.5 %    70.0 %\n"
            "hold            70.0       0.0           -    100.0 %         -\n"
            "worst frames: 000017 (9.0 mm)\n");
}

TEST(DescribeMeasured, ClockIsAnEstimateOrTheReasonWhyThereIsNone) {
  v1::Job job;
  v1::ClockEstimate& clock = *job.mutable_clock_estimate();
  clock.set_summary("the depth camera's clock is 4.00 ms ahead");
  clock.set_stamp_sigma_ns(60'000);
  clock.set_row_time_ns(12'000);
  clock.set_row_time_sigma_ns(800);
  EXPECT_EQ(DescribeMeasured(job),
            "clock: the depth camera's clock is 4.00 ms ahead\n"
            "corrected stamps are right to +-0.06 ms; rows of colour come 12.0 us after one another (+-0.8 us)\n");
  clock.set_summary("the images do not tell: nothing moves");
  clock.set_reason("nothing moves");
  EXPECT_EQ(DescribeMeasured(job), "clock: the images do not tell: nothing moves; the stamps are kept\n");
  job.mutable_self_check()->set_summary("no self-check: too short");
  job.mutable_self_check()->set_reason("too short");
  EXPECT_EQ(DescribeMeasured(job),
            "no self-check: too short\nclock: the images do not tell: nothing moves; the stamps are kept\n");
}

TEST(DescribeMeasured, WarningsAreSaidOnce) {
  v1::Job job;
  job.add_warnings("no depth frame holds a single measurement: every output will be unknown");
  job.mutable_clock_estimate()->set_summary("the images do not tell: nothing moves");
  job.mutable_clock_estimate()->set_reason("nothing moves");
  job.add_warnings("the images do not tell: nothing moves; the stamps are kept");
  EXPECT_EQ(DescribeMeasured(job),
            "clock: the images do not tell: nothing moves; the stamps are kept\n"
            "warning: no depth frame holds a single measurement: every output will be unknown\n");
}

}  // namespace
}  // namespace depthtween::cli
