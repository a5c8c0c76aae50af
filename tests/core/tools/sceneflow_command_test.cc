// The command against the scene's true motion, and against tasks that do the same.
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "core/io/file.h"
#include "core/io/flo.h"
#include "core/io/flow_png.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/synthetic/synthetic_sequence.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::tools {
namespace {

using testing::HasSubstr;

constexpr int kWidth = 128, kHeight = 106;

// Three frames of a scene with depth at every frame, exact, and their true motion.
void WriteRecording(const std::string& dir, double depth_fps) {
  const auto written = WriteSyntheticSequence({.scene = "pan",
                                               .frames = 3,
                                               .color_fps = 60,
                                               .depth_fps = depth_fps,
                                               .width = kWidth,
                                               .height = kHeight,
                                               .sensor = PerfectSensor()},
                                              dir, {});
  ASSERT_TRUE(written.ok()) << written;
}

// All formats say the same motion, and that explains nine tenths of the true one, which the camera's own makes.
TEST(SceneFlowCommand, WritesEveryFormat) {
  const TemporaryFolder scratch;
  WriteRecording(scratch / "in", 60);
  const ToolResult result = RunTool(
      {"sceneflow", scratch / "in", "-o", scratch / "out", "--format", "npz,flo,kitti", "--baseline", "0.5", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(result.out);
  EXPECT_EQ(report["method"], "ours");
  ASSERT_EQ(report["pairs"].size(), 2U);
  EXPECT_EQ(report["pairs"][1]["to"], "rgb/000002.jpg");
  EXPECT_EQ(report["pairs"][0]["answered_share"], 1.0);
  EXPECT_TRUE(FileExists(scratch / "out/preview.png"));
  EXPECT_EQ(nlohmann::json::parse(*ReadFile(scratch / "out/report.json")), report);

  const auto arrays = ReadNpz(scratch / "out/sceneflow/000000.npz");
  const auto truth = ReadNpz(scratch / "in/gt/sceneflow_key/000000_000001.npz");
  const auto flo = DecodeFlo(*ReadFile(scratch / "out/flow/000000.flo"));
  const auto change = DecodePfm(*ReadFile(scratch / "out/depth_change/000000.pfm"));
  const auto png = ReadFlowPng(scratch / "out/kitti/flow/000000.png");
  const auto now = ReadPng16(scratch / "out/kitti/disp_0/000000.png");
  const auto next = ReadPng16(scratch / "out/kitti/disp_1/000000.png");
  ASSERT_TRUE(arrays.ok() && truth.ok() && flo.ok() && change.ok() && png.ok() && now.ok() && next.ok());
  const std::vector<float> flow = arrays->at("flow").ToFloats(), motion = arrays->at("motion").ToFloats(),
                           depth = arrays->at("depth").ToFloats(), sf = truth->at("sf").ToFloats();
  const double disparity_m = 256 * 365.0 / 512 * kWidth * 0.5;  // 256 fx B
  double error = 0, still = 0;
  for (int i = 0; i < kWidth * kHeight; ++i) {
    ASSERT_EQ(flo->data()[i].u, flow[2 * i]);
    ASSERT_EQ(flo->data()[i].v, flow[2 * i + 1]);
    ASSERT_EQ(change->data()[i], motion[3 * i + 2]);
    ASSERT_NEAR(png->flow.data()[i].u, flow[2 * i], 0.008F);
    ASSERT_NEAR(now->data()[i], disparity_m / depth[i], 0.51);
    ASSERT_NEAR(next->data()[i], disparity_m / (depth[i] + motion[3 * i + 2]), 0.51);
    double squared = 0, length = 0;
    for (int c = 0; c < 3; ++c) {
      squared += std::pow(motion[3 * i + c] - sf[3 * i + c], 2);
      length += std::pow(sf[3 * i + c], 2);
    }
    error += std::sqrt(squared) / (kWidth * kHeight);
    still += std::sqrt(length) / (kWidth * kHeight);
  }
  EXPECT_FALSE(!(error <= 0.1 * still)) << error << " against " << still;
}

// As a server runs it: pairs in any order and batch, each by a process of its own; files as of the command.
TEST(SceneFlowCommand, TasksGiveTheSameFiles) {
  const TemporaryFolder scratch;
  WriteRecording(scratch / "in", 60);
  ASSERT_EQ(RunTool({"sceneflow", scratch / "in", "-o", scratch / "whole", "--format", "npz,flo"}).exit_code, 0);
  ASSERT_TRUE(WriteFile(scratch / "options.json", R"({"scene_flow": {"formats": ["npz", "flo"]}})").ok());
  const auto task = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "task");
    for (const std::string& word : {std::string("--sequence"), scratch / "in", std::string("--options"),
                                    scratch / "options.json", std::string("--constants"), scratch / "plan.json"})
      arguments.push_back(word);
    return RunTool(arguments);
  };
  ASSERT_EQ(task({"prepare"}).exit_code, 0);
  const nlohmann::json plan = nlohmann::json::parse(*ReadFile(scratch / "plan.json"));
  ASSERT_EQ(plan["intervals"].size(), 2U);
  EXPECT_EQ(plan["frames"][1]["stem"], "000001");
  EXPECT_EQ(task({"intervals", "--first", "2", "--count", "1", "--out", scratch / "parts"}).exit_code, 1);
  for (const char* first : {"1", "0"})
    ASSERT_EQ(task({"intervals", "--first", first, "--count", "1", "--out", scratch / "parts"}).exit_code, 0);
  const ToolResult assembled = task({"assemble", "--out", scratch / "parts"});
  ASSERT_EQ(assembled.exit_code, 0) << assembled.err;
  for (const std::string file :
       {"sceneflow/000000.npz", "sceneflow/000001.npz", "flow/000001.flo", "depth_change/000000.pfm", "preview.png"})
    EXPECT_EQ(*ReadFile(scratch / ("parts/" + file)), *ReadFile(scratch / ("whole/" + file))) << file;
  const nlohmann::json report = nlohmann::json::parse(*ReadFile(scratch / "parts/report.json"));
  EXPECT_EQ(report["pairs"][1]["from"], "rgb/000001.jpg");

  ASSERT_TRUE(WriteFile(scratch / "options.json", R"({"scene_flow": {"every": 3}})").ok());
  const ToolResult too_few = task({"prepare"});
  EXPECT_EQ(too_few.exit_code, 1);
  EXPECT_THAT(too_few.err, HasSubstr("has 3 colour frames, must have at least 4"));
  ASSERT_TRUE(WriteFile(scratch / "options.json", R"({"scene_flow": {"luck": 3}})").ok());
  EXPECT_THAT(task({"prepare"}).err, HasSubstr("scene_flow_options.luck"));
}

// Depth at half the rate: the refusal names the frames without depth and how to fix it; nothing is written.
TEST(SceneFlowCommand, NamesFramesWithoutDepth) {
  const TemporaryFolder scratch;
  WriteRecording(scratch / "in", 30);
  const ToolResult result = RunTool({"sceneflow", scratch / "in", "-o", scratch / "out"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("not at the same rate: 1 of 3 colour frames have no depth"));
  EXPECT_THAT(result.err, HasSubstr("rgb/000001.jpg"));
  EXPECT_FALSE(FileExists(scratch / "out/report.json"));

  // As a server asks before it takes an order.
  ASSERT_TRUE(WriteFile(scratch / "options.json", R"({"scene_flow":{"every":2}})").ok());
  const std::vector<std::string> plan = {"task",       "plan",
                                         "--sequence", scratch / "in",
                                         "--options",  scratch / "options.json",
                                         "--out",      scratch / "plan.json"};
  const ToolResult planned = RunTool(plan);
  EXPECT_EQ(planned.exit_code, 1);
  EXPECT_THAT(planned.err, HasSubstr("not at the same rate: 1 of 3 colour frames have no depth"));
  EXPECT_FALSE(FileExists(scratch / "plan.json"));
}

// An earlier result is replaced only when that is said.
TEST(SceneFlowCommand, KeepsWhatIsThere) {
  const TemporaryFolder scratch;
  WriteRecording(scratch / "in", 60);
  const std::vector<std::string> command = {"sceneflow", scratch / "in", "-o", scratch / "out", "--every", "2"};
  ASSERT_EQ(RunTool(command).exit_code, 0);
  const ToolResult again = RunTool(command);
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.err, HasSubstr("--force"));
  std::vector<std::string> forced = command;
  forced.emplace_back("--force");
  EXPECT_EQ(RunTool(forced).exit_code, 0);
  EXPECT_TRUE(FileExists(scratch / "out/sceneflow/000000.npz"));
  EXPECT_FALSE(FileExists(scratch / "out/sceneflow/000001.npz"));
}

// The upsampling's scene flow of frames between depth frames, against the exact motion of the rendered scene: it
// explains most of it. Held frames and baselines have none, and that is said.
TEST(UpsampleSceneFlow, IsTheMotionOfEveryFrame) {
  const TemporaryFolder scratch;
  const SyntheticOptions options = {
      .scene = "pan", .frames = 10, .width = kWidth, .height = kHeight, .sensor = PerfectSensor()};
  ASSERT_TRUE(WriteSyntheticSequence(options, scratch / "in", {}).ok());
  const ToolResult result = RunTool({"upsample", scratch / "in", "-o", scratch / "out", "--scene-flow"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const nlohmann::json report = nlohmann::json::parse(*ReadFile(scratch / "out/report.json"));
  EXPECT_EQ(report["scene_flow_frames"], 8);
  EXPECT_FALSE(FileExists(scratch / "out/sceneflow/000009.npz"));
  const auto arrays = ReadNpz(scratch / "out/sceneflow/000003.npz");
  ASSERT_TRUE(arrays.ok()) << arrays.status();
  const std::vector<float> motion = arrays->at("motion").ToFloats(), confidence = arrays->at("confidence").ToFloats();
  const auto clip = SyntheticSequence::Create(options);
  ASSERT_TRUE(clip.ok());
  const MotionTruth truth = (*clip)->ColorView(3).MotionTo((*clip)->ColorView(4), 1);
  double error = 0, still = 0;
  for (int i = 0; i < kWidth * kHeight; ++i) {
    if (!(confidence[i] > 0.5F)) continue;
    const Float3 t = truth.scene_flow.data()[i];
    error += std::sqrt(std::pow(motion[3 * i] - t.x, 2) + std::pow(motion[3 * i + 1] - t.y, 2) +
                       std::pow(motion[3 * i + 2] - t.z, 2));
    still += std::sqrt(t.x * t.x + t.y * t.y + t.z * t.z);
  }
  EXPECT_FALSE(!(error <= 0.5 * still)) << error << " against " << still;

  const ToolResult baseline =
      RunTool({"upsample", scratch / "in", "-o", scratch / "none", "--method", "linear", "--scene-flow"});
  EXPECT_NE(baseline.exit_code, 0);
  EXPECT_THAT(baseline.err, HasSubstr("scene_flow is for method 'ours' alone"));
}

}  // namespace
}  // namespace depthtween::tools
