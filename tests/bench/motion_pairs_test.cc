// Pairs of frames with truth. A scene and its files must agree, within what the files round.
#include "tests/bench/motion_pairs.h"

#include <cmath>
#include <filesystem>

#include "core/io/file.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

SyntheticOptions Options() {
  return {.scene = "bounce", .frames = 17, .width = 96, .height = 80, .sensor = PerfectSensor()};
}

double Length(const Float3& a) { return std::sqrt(double{a.x} * a.x + double{a.y} * a.y + double{a.z} * a.z); }

// The folder holds the scene's truth as files: both ways of reading must agree within what the files round (half
// floats, 1/64 px), and frame to frame, where the folder only has flow and depth, within a pixel's sampling.
TEST(MotionPairs, FolderAndSceneAgree) {
  const TemporaryFolder scratch;
  ASSERT_TRUE(WriteSyntheticSequence(Options(), scratch / "clip", {}).ok());
  const auto clip = SyntheticSequence::Create(Options());
  ASSERT_TRUE(clip.ok());
  const auto of_scene = ScenePairs(**clip, 8, 1, 1);
  const auto of_folder = FolderPairs(scratch / "clip", 1);
  ASSERT_TRUE(of_folder.ok()) << of_folder.status();
  ASSERT_EQ(of_scene.size(), 2U);
  ASSERT_EQ(of_folder->size(), 2U);
  for (int kind = 0; kind < 2; ++kind) {
    SCOPED_TRACE(PairStepName(of_scene[kind]->step()));
    ASSERT_EQ(of_scene[kind]->step(), (*of_folder)[kind]->step());
    ASSERT_EQ(of_scene[kind]->count(), 1);
    const auto exact = of_scene[kind]->Read(0), read = (*of_folder)[kind]->Read(0);
    ASSERT_TRUE(exact.ok() && read.ok()) << read.status();
    ASSERT_TRUE(exact->has_truth && read->has_truth);
    int both = 0;
    double sum = 0;
    for (size_t i = 0; i < exact->valid.pixel_count(); ++i) {
      if (read->valid.data()[i] == 0) continue;
      ASSERT_NE(exact->valid.data()[i], 0);
      ++both;
      ASSERT_NEAR(read->flow_px.data()[i].u, exact->flow_px.data()[i].u, 0.01F);
      ASSERT_NEAR(read->true_depth_m.data()[i], exact->true_depth_m.data()[i], 2e-4F);
      const Float3 a = read->motion_m.data()[i], b = exact->motion_m.data()[i];
      sum += Length({a.x - b.x, a.y - b.y, a.z - b.z});
    }
    EXPECT_GE(both, 0.8 * 96 * 80);
    EXPECT_FALSE(!(sum / both <= 5e-4));
  }
}

// Without truth there is depth to compare with; with one depth map there is nothing.
TEST(MotionPairs, WithoutTruth) {
  const TemporaryFolder scratch;
  ASSERT_TRUE(WriteSyntheticSequence(Options(), scratch / "clip", {.truth = false}).ok());
  const auto pairs = FolderPairs(scratch / "clip", 5);
  ASSERT_TRUE(pairs.ok()) << pairs.status();
  ASSERT_EQ(pairs->size(), 1U);
  EXPECT_EQ((*pairs)[0]->count(), 2);
  const auto pair = (*pairs)[0]->Read(1);
  ASSERT_TRUE(pair.ok()) << pair.status();
  EXPECT_FALSE(pair->has_truth);
  EXPECT_FALSE(pair->to_camera.has_value());

  SyntheticOptions one = Options();
  one.frames = 2;
  ASSERT_TRUE(WriteSyntheticSequence(one, scratch / "short", {.truth = false}).ok());
  EXPECT_EQ(FolderPairs(scratch / "short", 5).status().code(), absl::StatusCode::kFailedPrecondition);
}

// The second frame's own camera is read, and a broken one is named.
TEST(MotionPairs, SecondCamera) {
  const TemporaryFolder scratch;
  ASSERT_TRUE(WriteSyntheticSequence(Options(), scratch / "clip", {.truth = false}).ok());
  const std::string camera = scratch / "clip/camera_second.json";
  ASSERT_TRUE(WriteFile(camera, R"({"width":96,"height":80,"fx":70,"fy":70,"cx":60,"cy":40,"depth_scale":1})").ok());
  const auto pairs = FolderPairs(scratch / "clip", 1);
  ASSERT_TRUE(pairs.ok()) << pairs.status();
  const auto pair = (*pairs)[0]->Read(0);
  ASSERT_TRUE(pair.ok() && pair->to_camera.has_value());
  EXPECT_EQ(pair->to_camera->cx, 60);
  ASSERT_TRUE(WriteFile(camera, "{}").ok());
  EXPECT_THAT(std::string(FolderPairs(scratch / "clip", 1).status().message()), HasSubstr("camera_second.json"));
}

}  // namespace
}  // namespace depthtween
