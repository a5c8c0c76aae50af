// A ball drawn at known places: its motion, and where flow alone must lose it.
#include "core/flow/lost_motion.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/flow/dense_flow.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kWidth = 160, kHeight = 120;
constexpr DenseFlowOptions kFlow{
    .finest_scale = 1, .patch_stride = 4, .descent_iterations = 16, .refinement_iterations = 0};

uint8_t Wall(int x, int y) {
  return static_cast<uint8_t>(
      std::lround(90 + 40 * std::sin(0.31 * x + 0.17 * y) + 30 * std::sin(0.21 * x - 0.43 * y)));
}

// A spotted ball before a wall that stands still.
Image<uint8_t> BallAt(int centre_x, int centre_y, int radius = 7) {
  Image<uint8_t> image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const int dx = x - centre_x, dy = y - centre_y;
      const bool ball = dx * dx + dy * dy <= radius * radius;
      image(x, y) = ball ? static_cast<uint8_t>(210 + 8 * ((dx + 21) / 3 % 3) + 6 * ((dy + 20) / 4 % 3)) : Wall(x, y);
    }
  return image;
}

struct Flows {
  Image<Flow2> ab, ba;
};
Flows FlowsBetween(const Image<uint8_t>& a, const Image<uint8_t>& b) {
  return {*DenseFlow(a, b, kFlow), *DenseFlow(b, a, kFlow)};
}

float Off(Flow2 f, float u, float v) { return std::hypot(f.u - u, f.v - v); }

bool Same(const Image<Flow2>& a, const Image<Flow2>& b) {
  return std::equal(a.data(), a.data() + a.pixel_count(), b.data(),
                    [](Flow2 p, Flow2 q) { return p.u == q.u && p.v == q.v; });
}

// The ball moves by its own size: coarse-to-fine flow does not find it (or this test would show nothing), in neither
// direction. Afterwards both are right on the whole ball, and the wall away from it has the flow that it had.
TEST(RecoverLostMotion, FindsABallThatMovesByItsOwnSize) {
  const Image<uint8_t> a = BallAt(60, 50), b = BallAt(74, 41);
  Flows flows = FlowsBetween(a, b);
  ASSERT_GT(Off(flows.ab(60, 50), 14, -9), 4);
  ASSERT_GT(Off(flows.ba(74, 41), -14, 9), 4);
  const Image<Flow2> before = flows.ab.Clone();
  RecoverLostMotion(a, b, flows.ab, flows.ba);
  for (int dy = -3; dy <= 3; ++dy)
    for (int dx = -3; dx <= 3; ++dx) {
      EXPECT_LE(Off(flows.ab(60 + dx, 50 + dy), 14, -9), 0.7F) << dx << "," << dy;
      EXPECT_LE(Off(flows.ba(74 + dx, 41 + dy), -14, 9), 0.7F) << dx << "," << dy;
    }
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const bool far_away = std::hypot(x - 60, y - 50) > 20 && std::hypot(x - 74, y - 41) > 20;
      ASSERT_TRUE(!far_away || Off(flows.ab(x, y), before(x, y).u, before(x, y).v) == 0) << x << "," << y;
    }
}

// 36 pixels are beyond the reach of the full resolution, and within that of half of it.
TEST(RecoverLostMotion, ReachesFartherAtHalfResolution) {
  const Image<uint8_t> a = BallAt(50, 50, 14), b = BallAt(86, 60, 14);
  Flows flows = FlowsBetween(a, b);
  ASSERT_GT(Off(flows.ab(50, 50), 36, 10), 4);
  RecoverLostMotion(a, b, flows.ab, flows.ba);
  EXPECT_GT(Off(flows.ab(50, 50), 36, 10), 4);
  EXPECT_TRUE(RecoverLostMotion(a, b, flows.ab, flows.ba, {.scales = 2}));
  for (int d = -3; d <= 3; ++d) {
    EXPECT_LE(Off(flows.ab(50 + d, 50 - d), 36, 10), 1.5F) << d;
    EXPECT_LE(Off(flows.ba(86 + d, 60 - d), -36, -10), 1.5F) << d;
  }
  EXPECT_FALSE(RecoverLostMotion(a, a, flows.ab, flows.ba, {.scales = 0}));
}

// A ball that has gone was seen by one frame alone: nothing of the other's may be taken for it.
TEST(RecoverLostMotion, LeavesWhatOneFrameAloneSees) {
  const Image<uint8_t> a = BallAt(60, 50), b = BallAt(-100, -100);
  Flows flows = FlowsBetween(a, b);
  const Image<Flow2> before = flows.ab.Clone();
  RecoverLostMotion(a, b, flows.ab, flows.ba);
  for (int dy = -4; dy <= 4; ++dy)
    for (int dx = -4; dx <= 4; ++dx)
      EXPECT_EQ(Off(flows.ab(60 + dx, 50 + dy), before(60 + dx, 50 + dy).u, before(60 + dx, 50 + dy).v), 0);
}

// Two balls alike before a plain wall: the first frame's may have become either. Which, is not guessed where only what
// is distinct counts; one ball alone is found then as before.
TEST(RecoverLostMotion, LeavesWhatHasADouble) {
  const auto balls_at = [](const std::vector<std::pair<int, int>>& centres) {
    Image<uint8_t> image(kWidth, kHeight, uint8_t{60});
    for (const auto& [x, y] : centres) {
      const Image<uint8_t> ball = BallAt(x, y);
      for (int dy = -7; dy <= 7; ++dy)
        for (int dx = -7; dx <= 7; ++dx)
          if (dx * dx + dy * dy <= 49) image(x + dx, y + dy) = ball(x + dx, y + dy);
    }
    return image;
  };
  const Image<uint8_t> a = balls_at({{60, 50}});
  for (const bool doubled : {false, true}) {
    const Image<uint8_t> b = doubled ? balls_at({{76, 41}, {48, 66}}) : balls_at({{76, 41}});
    Flows flows = FlowsBetween(a, b);
    const Flow2 before = flows.ab(60, 50);
    RecoverLostMotion(a, b, flows.ab, flows.ba, {.distinct = 1.3F});
    const Flow2 after = flows.ab(60, 50);
    EXPECT_EQ(Off(after, 16, -9) <= 0.7F, !doubled) << after.u << "," << after.v;
    EXPECT_EQ(Off(after, before.u, before.v) == 0, doubled) << before.u << "," << before.v;
  }
}

// A cut: hardly anything is explained, and nothing of it is motion.
TEST(RecoverLostMotion, LeavesACutAlone) {
  Image<uint8_t> a(kWidth, kHeight), b(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) a(x, y) = Wall(x, y), b(x, y) = static_cast<uint8_t>(255 - Wall(3 * y, 2 * x));
  Flows flows = FlowsBetween(a, b);
  const Flows before{flows.ab.Clone(), flows.ba.Clone()};
  RecoverLostMotion(a, b, flows.ab, flows.ba);
  EXPECT_TRUE(Same(flows.ab, before.ab));
  EXPECT_TRUE(Same(flows.ba, before.ba));
}

TEST(RecoverLostMotion, LeavesSmallImagesAlone) {
  Image<uint8_t> a(40, 30, uint8_t{10}), b(40, 30, uint8_t{200});
  Image<Flow2> ab(40, 30, Flow2{1, 2}), ba(40, 30, Flow2{-1, -2});
  EXPECT_FALSE(RecoverLostMotion(a, b, ab, ba, {.scales = 3}));
  EXPECT_EQ(ab(20, 15).u, 1);
  EXPECT_EQ(ba(20, 15).v, -2);
}

}  // namespace
}  // namespace depthtween
