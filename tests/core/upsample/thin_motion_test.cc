// A bar that moves by a known step, and flow that has lost it on purpose.
#include "core/upsample/thin_motion.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/upsample/keys.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kFrameWidth = 96, kFrameHeight = 80, kLeft = 30, kStep = 4;
constexpr float kNear = 1.5F, kFar = 3.0F;
constexpr DepthNoise kNoise{};

Rgb8 Wall(int x, int y) {
  const auto wave = [&](double a, double b) {
    return static_cast<uint8_t>(std::lround(120 + 70 * std::sin(a * x + b * y)));
  };
  return {wave(0.41, 0.27), wave(0.33, -0.52), wave(-0.22, 0.61)};
}

struct Scene {
  Image<Rgb8> color{kFrameWidth, kFrameHeight};
  Image<float> depth_m{kFrameWidth, kFrameHeight};
};

// A bar of so many pixels from column `left` on, before a wall that stands still.
Scene BarAt(int left, int thickness) {
  Scene scene;
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      const bool bar = x >= left && x < left + thickness;
      scene.color(x, y) = bar ? Rgb8{200, static_cast<uint8_t>(150 + 4 * (y / 3 % 5)), 60} : Wall(x, y);
      scene.depth_m(x, y) = bar ? kNear : kFar;
    }
  return scene;
}

Key KeyOf(const Scene& scene) {
  return {.depth_m = scene.depth_m.Clone(),
          .distance = Image<float>(kFrameWidth, kFrameHeight),
          .image = MatchImage(scene.color)};
}

int Proposed(const Image<Flow2>& motion) {
  return static_cast<int>(
      std::count_if(motion.data(), motion.data() + motion.pixel_count(), [](Flow2 m) { return m.u != 0 || m.v != 0; }));
}

Image<Flow2> Everywhere(Flow2 motion) {
  Image<Flow2> flow(kFrameWidth, kFrameHeight);
  flow.Fill(motion);
  return flow;
}

// Flow has the wall's motion, none: as it does when a window shows mostly the wall.
TEST(ThinMotion, FindsABarThatFlowLost) {
  const Scene scene = BarAt(kLeft, 3);
  ThinMotion things(KeyOf(scene), scene.color, kNoise);
  for (int frame = 1; frame <= 6; ++frame) {
    const int moved = frame * kStep;
    const Image<Flow2> motion = things.Follow(BarAt(kLeft + moved, 3).color, Everywhere({}));
    for (int y = 2; y < kFrameHeight - 2; ++y) {
      for (int x = kLeft + moved; x < kLeft + moved + 3; ++x) {
        EXPECT_EQ(motion(x, y).u, -moved) << "frame " << frame << " at " << x << ", " << y;
        EXPECT_LE(std::abs(motion(x, y).v), 1) << "frame " << frame << " at " << x << ", " << y;
      }
      // Nothing moves where the wall is seen, but for a pixel beside the bar.
      EXPECT_EQ(motion(kLeft + moved - 3, y), Flow2{});
      EXPECT_EQ(motion(kLeft + moved + 5, y), Flow2{});
    }
  }
}

TEST(ThinMotion, FindsItWithoutFlow) {
  const Scene scene = BarAt(kLeft, 3);
  ThinMotion things(KeyOf(scene), scene.color, kNoise);
  const Image<Flow2> motion = things.Follow(BarAt(kLeft + kStep, 3).color, {});
  EXPECT_EQ(motion(kLeft + kStep + 1, 40).u, -kStep);
}

TEST(ThinMotion, LeavesToFlowWhatFlowExplains) {
  const Scene scene = BarAt(kLeft, 3);
  ThinMotion things(KeyOf(scene), scene.color, kNoise);
  EXPECT_EQ(Proposed(things.Follow(BarAt(kLeft + kStep, 3).color, Everywhere({kStep, 0}))), 0);
  // The same bar stands still and flow says so.
  ThinMotion still(KeyOf(scene), scene.color, kNoise);
  EXPECT_EQ(Proposed(still.Follow(scene.color, Everywhere({}))), 0);
}

TEST(ThinMotion, LooksForThinThingsAlone) {
  const Scene scene = BarAt(kLeft, 28);
  ThinMotion things(KeyOf(scene), scene.color, kNoise);
  EXPECT_EQ(Proposed(things.Follow(BarAt(kLeft + kStep, 28).color, Everywhere({}))), 0);
}

// Behind the picture's edge, or behind something else, nothing is made up, and nothing comes back by chance.
TEST(ThinMotion, GivesUpWhatIsOutOfSight) {
  const Scene scene = BarAt(kLeft, 3);
  ThinMotion things(KeyOf(scene), scene.color, kNoise);
  EXPECT_EQ(Proposed(things.Follow(BarAt(kFrameWidth, 0).color, Everywhere({}))), 0);
  EXPECT_EQ(Proposed(things.Follow(BarAt(kLeft + kStep, 3).color, Everywhere({}))), 0);
}

}  // namespace
}  // namespace depthtween
