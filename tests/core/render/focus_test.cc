#include "core/render/focus.h"

#include <cmath>
#include <memory>

#include "core/synthetic/render.h"
#include "core/synthetic/stage.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

TEST(FocusDepthOf, GoesFromKeyToKeyInInverseDepth) {
  FocusKeys keys{.keys = {{10, 1.0}, {20, 4.0}, {40, 2.0}}, .easing = FocusEasing::kLinear};
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 0), 1.0);
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 10), 1.0);
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 15), 1 / (0.5 / 1.0 + 0.5 / 4.0));
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 20), 4.0);
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 25), 1 / (0.75 / 4.0 + 0.25 / 2.0));
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 99), 2.0);
  // Eased: the same keys and middle, but slow at both ends.
  keys.easing = FocusEasing::kSmooth;
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 20), 4.0);
  EXPECT_DOUBLE_EQ(FocusDepthOf(keys, 15), 1 / (0.5 / 1.0 + 0.5 / 4.0));
  EXPECT_LT(1 / FocusDepthOf(keys, 10) - 1 / FocusDepthOf(keys, 11), 0.5 * 0.1 * 0.75);
}

// Whoever points beside a post means the post, not the wall three metres behind it.
TEST(StartFocus, TakesTheNearestSurfaceAtThePoint) {
  Image<float> depth(40, 30, 5.0F);
  for (int y = 0; y < 30; ++y) depth(20, y) = 2.0F;
  depth(5, 5) = 0;
  EXPECT_NEAR(StartFocus({3, 21, 12}, depth)->depth_m, 2.0, 1e-6);
  EXPECT_NEAR(StartFocus({3, 25, 12}, depth)->depth_m, 5.0, 1e-6);
  EXPECT_NEAR(StartFocus({3, 5, 5}, depth)->depth_m, 5.0, 1e-6) << "a hole is bridged";
  EXPECT_EQ(StartFocus({3, 40, 12}, depth).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(StartFocus({3, std::nan(""), 12}, depth).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(StartFocus({3, 4, 4}, Image<float>(9, 9)).status().code(), absl::StatusCode::kNotFound);
}

constexpr Camera kCamera{.width = 160, .height = 132, .fx = 114, .fy = 114, .cx = 79.5, .cy = 65.5};

// A ball swings towards the camera and across; its centre is known at every time, and so are its depth and its motion.
TEST(FollowFocus, StaysOnAMovingBallThereAndBack) {
  Scene scene("ball");
  AddRoom(scene, {.floor = {}, .back_wall = {}, .side_wall = {}});
  const auto place = [](double t) { return At(-0.8 + 1.6 * t, 3.2 - 1.2 * t, 1.2); };
  scene.AddPart(scene.AddBody("ball", place), MakeBall(0.15), Affine::Identity(), {});
  scene.SetCamera([](double) { return LookAt({0, -0.1, 1.2}, {0, 3, 1.2}); });
  constexpr int kFrames = 60;
  const auto view = [&](int frame) { return RendererAt(scene, kCamera, frame / 60.0); };
  const auto truth_m = [&](int frame) { return place(frame / 60.0).translation().y() + 0.1 - 0.15; };

  FocusPoint point{};
  for (const int step : {1, -1}) {
    const int first = step > 0 ? 0 : kFrames, last = step > 0 ? kFrames : 0;
    Image<float> depth = view(first).Surface(2).depth_m;
    if (step > 0) {
      const Vec3 center = place(0).translation();
      const Vec2 pixel = kCamera.Project({center.x(), 1.2 - center.z(), center.y() + 0.1});
      point = *StartFocus({0, pixel.x(), pixel.y()}, depth);
    }
    for (int frame = first; frame != last; frame += step) {
      const MotionTruth motion = view(frame).MotionTo(view(frame + step), 2);
      Image<float> next_depth = view(frame + step).Surface(2).depth_m;
      point = FollowFocus(point, depth, motion.flow, frame + step, next_depth);
      depth = std::move(next_depth);
      ASSERT_EQ(point.frame, frame + step);
      ASSERT_NEAR(point.depth_m, truth_m(frame + step), 0.06) << "frame " << frame + step;
    }
  }
}

// Hidden for some frames, the surface is waited for, with the focus held where it was.
TEST(FollowFocus, WaitsForAHiddenSurface) {
  const Image<float> open(30, 30, 3.0F), covered(30, 30, 1.0F);
  const Image<Flow2> still(30, 30);
  FocusPoint point = *StartFocus({0, 15, 15}, open);
  point = FollowFocus(point, open, still, 1, covered);
  EXPECT_DOUBLE_EQ(point.depth_m, 3.0);
  point = FollowFocus(point, covered, still, 2, covered);
  EXPECT_DOUBLE_EQ(point.depth_m, 3.0);
  const Image<float> nearer(30, 30, 2.9F);
  point = FollowFocus(point, covered, {}, 3, nearer);
  EXPECT_FLOAT_EQ(static_cast<float>(point.depth_m), 2.9F);
}

// A point that leaves the image neither comes back elsewhere nor loses its depth.
TEST(FollowFocus, LeavesTheImageWithItsDepth) {
  const Image<float> depth(30, 30, 3.0F);
  const Image<Flow2> fast(30, 30, {9.0F, 0.0F});
  FocusPoint point = *StartFocus({0, 20, 15}, depth);
  for (int frame = 1; frame < 6; ++frame) point = FollowFocus(point, depth, fast, frame, depth);
  EXPECT_GT(point.x, 29.5);
  EXPECT_DOUBLE_EQ(point.depth_m, 3.0);
}

}  // namespace
}  // namespace depthtween
