// Focus on things whose distance is known in closed form at every time.
#include "core/render/focus.h"

#include <cmath>

#include "core/geometry/camera.h"
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

// A coin of 15 cm radius that crosses the picture and comes nearer, before a wall at 5 m: all is known in closed form.
class Coin {
 public:
  static constexpr int kWidth = 160, kHeight = 120;
  static double DepthAt(int frame) { return 3.2 - 0.02 * frame; }
  static Vec2 CenterAt(int frame) { return Vec2(80 + 114 * (-0.8 + 0.027 * frame) / DepthAt(frame), 60 + 0.2 * frame); }
  static double RadiusAt(int frame) { return 114 * 0.15 / DepthAt(frame); }

  static Image<float> Depth(int frame) {
    Image<float> depth(kWidth, kHeight, 5.0F);
    Visit(frame, [&](int x, int y) { depth(x, y) = static_cast<float>(DepthAt(frame)); });
    return depth;
  }
  static Image<Flow2> Motion(int from, int to) {
    Image<Flow2> motion(kWidth, kHeight);
    Visit(from, [&](int x, int y) {
      const Vec2 moved = CenterAt(to) + (Vec2(x, y) - CenterAt(from)) * DepthAt(from) / DepthAt(to) - Vec2(x, y);
      motion(x, y) = {static_cast<float>(moved.x()), static_cast<float>(moved.y())};
    });
    return motion;
  }

 private:
  template <typename Body>
  static void Visit(int frame, const Body& body) {
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if ((Vec2(x, y) - CenterAt(frame)).norm() < RadiusAt(frame)) body(x, y);
  }
};

TEST(FollowFocus, StaysOnAMovingCoinThereAndBack) {
  constexpr int kFrames = 50;
  const Vec2 start = Coin::CenterAt(0) + Vec2(2, 1);
  FocusPoint point = *StartFocus({0, start.x(), start.y()}, Coin::Depth(0));
  for (int frame = 0, step = 1; frame >= 0; frame += step) {
    if (frame == kFrames) step = -1;
    if (frame + step < 0) break;
    point = FollowFocus(point, Coin::Depth(frame), Coin::Motion(frame, frame + step), frame + step,
                        Coin::Depth(frame + step));
    ASSERT_EQ(point.frame, frame + step);
    ASSERT_NEAR(point.depth_m, Coin::DepthAt(frame + step), 1e-5);
    ASSERT_LT((Vec2(point.x, point.y) - Coin::CenterAt(frame + step)).norm(), Coin::RadiusAt(frame + step));
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
