// A self-check must give the numbers of the leave-out experiment that it stands for.
#include "core/session/self_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <atomic>
#include <nlohmann/json.hpp>

#include <algorithm>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "core/session/evaluation.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

// A tiny recording has a depth frame at colour frames 2, 10, 18...
std::unique_ptr<SequenceFolder> Recording(const TemporaryFolder& scratch, int color_frames) {
  WriteTinyRecording(scratch / "recording", 64, 48, color_frames);
  return SequenceFolder::Open(scratch / "recording").value();
}

SelfCheck Check(const SequenceFolder& recording, const UpsampleOptions& options) {
  const auto check = CheckSelf(recording, options);
  EXPECT_TRUE(check.ok()) << check.status();
  return check.ok() ? *check : SelfCheck{.reason = "failed"};
}

// A check is a leave-out experiment at half the rate: upsampling with every second depth frame and evaluating the
// result against the others must give the same numbers, to the last bit.
TEST(SelfCheck, GivesTheNumbersOfALeaveOutExperiment) {
  const TemporaryFolder scratch;
  const auto recording = Recording(scratch, 80);
  const SelfCheck check = Check(*recording, {.preset = "fast"});
  ASSERT_EQ(check.reason, "");
  const ToolResult run =
      RunTool({"upsample", scratch / "recording", "-o", scratch / "half", "--preset", "fast", "--key-every", "2"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto evaluation = Evaluate({.result_dir = scratch / "half",
                                    .reference_dir = scratch / "recording",
                                    .baselines = {"flow-warp", "linear", "hold"}});
  ASSERT_TRUE(evaluation.ok()) << evaluation.status();
  ASSERT_EQ(check.maps_checked, 4) << "keys 1, 3, 5 and 7; 9 comes after the last input";
  EXPECT_EQ(check.maps_held_out, 4);
  EXPECT_EQ(check.pixels, evaluation->score.common_pixels);
  ASSERT_EQ(check.methods.size(), 4U);
  for (size_t m = 0; m < check.methods.size(); ++m) {
    const MethodScore& expected = evaluation->score.methods[m];
    EXPECT_EQ(check.methods[m].name, expected.name);
    EXPECT_EQ(check.methods[m].rmse_mm, expected[Region::kAll].rmse_mm) << expected.name;
    EXPECT_EQ(check.methods[m].mae_mm, expected[Region::kAll].mae_mm) << expected.name;
    EXPECT_EQ(check.methods[m].edge_band_rmse_mm, expected[Region::kEdgeBand].rmse_mm) << expected.name;
    EXPECT_EQ(check.methods[m].completeness, expected.completeness) << expected.name;
  }
  ASSERT_TRUE(check.methods[0].within_one_sigma.has_value());
  const auto& coverage = evaluation->score.methods[0].uncertainty.coverage;
  const auto one = std::find_if(coverage.begin(), coverage.end(), [](const auto& at) { return at.k == 1.0; });
  ASSERT_NE(one, coverage.end());
  EXPECT_EQ(*check.methods[0].within_one_sigma, one->share);
  EXPECT_FALSE(check.methods[1].within_one_sigma.has_value()) << "a baseline does not know its errors";

  std::vector<double> frames_mm;
  for (const FrameScore& frame : evaluation->score.frames) frames_mm.push_back(frame.rmse_mm[0]);
  ASSERT_EQ(check.worst_frames.size(), 4U);
  EXPECT_EQ(check.worst_frames[0].rmse_mm, *std::max_element(frames_mm.begin(), frames_mm.end()));
  for (const SelfCheck::Frame& frame : check.worst_frames) {
    EXPECT_EQ(frame.frame % 16, 10) << "where held-out depth frames are";
    EXPECT_EQ(frame.time_ns, recording->sequence().color[frame.frame].time_ns);
    EXPECT_EQ(frame.stem, recording->sequence().color[frame.frame].Stem());
  }
}

TEST(SelfCheck, DoesNotDependOnThreads) {
  const TemporaryFolder scratch;
  const auto recording = Recording(scratch, 40);
  json one = ToJson(Check(*recording, {.threads = 1})), three = ToJson(Check(*recording, {.threads = 3}));
  one.erase("seconds"), three.erase("seconds");
  EXPECT_EQ(one, three);
}

// A long clip must not cost more than a short one, and its checks must not crowd at one end.
TEST(SelfCheck, IsBoundedAndSpread) {
  const TemporaryFolder scratch;
  const auto recording = Recording(scratch, 8 * 60);
  const SelfCheck check = Check(*recording, {.preset = "fast"});
  EXPECT_EQ(check.maps_held_out, 29);
  EXPECT_EQ(check.maps_checked, kMaxMapsChecked);
  EXPECT_EQ(check.worst_frames.size(), static_cast<size_t>(kWorstFramesTold));
  int told = 0;
  std::atomic<int> items{0};
  const auto counted = CheckSelf(
      *recording, {.preset = "fast", .without = {"draw"}}, {},
      [&](int done, int total) {
        EXPECT_EQ(done, told++);
        EXPECT_EQ(total, kMaxMapsChecked);
      },
      [&] { ++items; });
  EXPECT_GE(items, 2 * kMaxMapsChecked) << "while a map is checked, something is heard";
  EXPECT_TRUE(counted.ok()) << counted.status();
  EXPECT_EQ(told, kMaxMapsChecked);
}

// What the upsampling does not take as input is no truth: of keys 0, 2, 4, 6, 8 it is 2 and 6.
TEST(SelfCheck, IsOfTheInputAlone) {
  const TemporaryFolder scratch;
  const auto recording = Recording(scratch, 80);
  const SelfCheck check = Check(*recording, {.key_every = 2, .preset = "fast"});
  EXPECT_EQ(check.maps_held_out, 2);
  std::vector<int> frames;
  for (const SelfCheck::Frame& frame : check.worst_frames) frames.push_back(frame.frame);
  std::sort(frames.begin(), frames.end());
  EXPECT_THAT(frames, ElementsAre(2 + 2 * 8, 2 + 6 * 8));
}

TEST(SelfCheck, SaysWhyItCannot) {
  const TemporaryFolder scratch, other;
  const auto two = Recording(scratch, 16);
  EXPECT_THAT(Check(*two, {}).reason, HasSubstr("2 depth frames are input, and it takes 3"));
  EXPECT_THAT(Summary(Check(*two, {})), HasSubstr("no self-check: 2 depth frames"));
  EXPECT_EQ(ToJson(Check(*two, {})).at("reason"), Check(*two, {}).reason);

  // Colour every 10 ms, and depth 5 ms from any of it.
  const auto meeting = Recording(other, 40);
  std::string colors, depths;
  for (int i = 0; i < 40; ++i) absl::StrAppendFormat(&colors, "0.%02d %s\n", i, meeting->sequence().color[i].path);
  for (int i = 0; i < 5; ++i)
    absl::StrAppendFormat(&depths, "0.%03d %s\n", 10 * i + 5, meeting->sequence().depth[i].path);
  ASSERT_EQ(WriteFile(other / "recording/rgb.txt", colors), absl::OkStatus());
  ASSERT_EQ(WriteFile(other / "recording/depth.txt", depths), absl::OkStatus());
  const auto apart = SequenceFolder::Open(other / "recording");
  ASSERT_TRUE(apart.ok()) << apart.status();
  EXPECT_THAT(Check(**apart, {}).reason, HasSubstr("within 3 ms of a colour frame"));
}

TEST(SelfCheck, WrongOptionsAndStopsAreErrors) {
  const TemporaryFolder scratch;
  const auto recording = Recording(scratch, 40);
  EXPECT_TRUE(absl::IsInvalidArgument(CheckSelf(*recording, {.preset = "turbo"}).status()));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_TRUE(absl::IsCancelled(CheckSelf(*recording, {}, stop.get_token()).status()));
}

TEST(SelfCheck, SummaryIsASentence) {
  const SelfCheck check{.maps_checked = 1,
                        .maps_held_out = 1,
                        .pixels = 9,
                        .methods = {{.name = "ours", .rmse_mm = 12.34},
                                    {.name = "flow-warp", .rmse_mm = 17.0},
                                    {.name = "linear", .rmse_mm = 25.06},
                                    {.name = "hold", .rmse_mm = 40.2}},
                        .worst_frames = {{.frame = 3, .stem = "0123", .rmse_mm = 20}},
                        .sensor_floor = SelfCheck::Floor{.rmse_mm = 4.0}};
  EXPECT_EQ(Summary(check),
            "on your clip, at half the depth rate, ours errs by 12.3 mm RMSE (flow-warp 17.0, linear 25.1, hold 40.2); "
            "worst at frame 0123; the sensor differs from itself by 4.0 mm where nothing moves; the result is better "
            "than that, since its gaps are half as wide");
}

// The program and the steps of a server must say the same, and leave it in the report.
TEST(SelfCheck, StandsInTheReportOfEveryPath) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 64, 48, 40);
  const ToolResult local =
      RunTool({"upsample", scratch / "recording", "-o", scratch / "out", "--preset", "fast", "--self-check"});
  ASSERT_EQ(local.exit_code, 0) << local.err;
  EXPECT_THAT(local.out, HasSubstr("on your clip, at half the depth rate, ours errs by"));
  json expected = json::parse(ReadFile(scratch / "out/report.json").value());
  EXPECT_EQ(expected.at("options").at("self_check"), true);

  ASSERT_EQ(WriteFile(scratch / "options.json", R"({"upsample":{"preset":"fast","self_check":true}})"),
            absl::OkStatus());
  const auto task = [&](const std::string& step, const std::vector<std::string>& more) {
    std::vector<std::string> words = {
        "task", step, "--sequence", scratch / "recording", "--options", scratch / "options.json"};
    words.insert(words.end(), more.begin(), more.end());
    const ToolResult run = RunTool(words);
    EXPECT_EQ(run.exit_code, 0) << step << ": " << run.err;
  };
  const std::string constants = scratch / "constants.json", out = scratch / "task_out", check = scratch / "check.json";
  task("self-check", {"--out", check});
  task("prepare", {"--constants", constants});
  task("intervals", {"--constants", constants, "--out", out, "--first", "0", "--count", "6"});
  task("assemble", {"--constants", constants, "--out", out, "--self-check", check});
  json made = json::parse(ReadFile(scratch / "task_out/report.json").value());
  for (json* report : {&expected, &made}) report->at("self_check").erase("seconds");
  EXPECT_EQ(made.at("self_check"), expected.at("self_check"));
  EXPECT_EQ(made.at("self_check").at("maps_checked"), 2);

  ASSERT_EQ(RunTool({"upsample", scratch / "recording", "-o", scratch / "plain", "--preset", "fast"}).exit_code, 0);
  EXPECT_FALSE(json::parse(ReadFile(scratch / "plain/report.json").value()).contains("self_check"));
  const ToolResult mixed =
      RunTool({"upsample", scratch / "recording", "-o", scratch / "x", "--method", "hold", "--self-check"});
  EXPECT_EQ(mixed.exit_code, 1);
  EXPECT_THAT(mixed.err, HasSubstr("options.self_check is for method 'ours' alone"));
}

}  // namespace
}  // namespace depthtween
