// Windows on walls that move by a known shift.
#include "core/sceneflow/surface_windows.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kFrameWidth = 96, kFrameHeight = 64;
constexpr int kShift = 24;  // beyond what is searched, 0.2 of the width
constexpr float kDepthM = 2.0F;

// Squares of 4 x 4 pixels, each of a colour of its own.
uint8_t Level(int x, int y, int channel) {
  const uint32_t square = static_cast<uint32_t>((x + 1000) / 4 * 4099 + y / 4 * 131 + channel) * 2654435761U;
  return static_cast<uint8_t>(40 + (square >> 16) % 176);
}

// A wall that moves by kShift pixels to the right, at one depth.
class MovingWall {
 public:
  MovingWall() {
    for (int y = 0; y < kFrameHeight; ++y)
      for (int x = 0; x < kFrameWidth; ++x) {
        from_(x, y) = {Level(x, y, 0), Level(x, y, 1), Level(x, y, 2)};
        to_(x, y) = {Level(x - kShift, y, 0), Level(x - kShift, y, 1), Level(x - kShift, y, 2)};
      }
    pair_.from.color = from_, pair_.to.color = to_;
    pair_.from.depth_m = Image<float>(kFrameWidth, kFrameHeight, kDepthM);
    pair_.to.depth_m = Image<float>(kFrameWidth, kFrameHeight, kDepthM);
    pair_.from.distance = Image<float>(kFrameWidth, kFrameHeight);
    pair_.to.distance = Image<float>(kFrameWidth, kFrameHeight);
  }

  // Of every pixel, that it went `shift` pixels to the right.
  Image<PointMatch> Matches(float shift, float weight) const {
    Image<PointMatch> matches(kFrameWidth, kFrameHeight);
    for (int y = 0; y < kFrameHeight; ++y)
      for (int x = 0; x < kFrameWidth; ++x)
        matches(x, y) = {.point = pair_.rays.Point(x, y, kDepthM),
                         .place = {static_cast<float>(x) + shift, static_cast<float>(y)},
                         .depth_m = kDepthM,
                         .flow_weight = weight,
                         .depth_weight = weight};
    return matches;
  }

  SurfaceWindows Fit(const Image<PointMatch>& matches, const Image<PointMatch>& proposal) const {
    const Image<int> labels(kFrameWidth, kFrameHeight);
    const std::array<const Image<PointMatch>*, 1> proposals = {&proposal};
    return FitSurfaceWindows(pair_, labels, ToFloats(from_), ToFloats(to_), matches, proposals);
  }

  // How far a motion takes the window's pixel to the right, pixels.
  float ShiftOf(const Window& window, const RigidMotion& motion) const {
    return pair_.rays.Project(motion * pair_.rays.Point(window.x, window.y, kDepthM)).u - static_cast<float>(window.x);
  }

 private:
  const Camera camera_{.width = kFrameWidth, .height = kFrameHeight, .fx = 90, .fy = 90, .cx = 47.5, .cy = 31.5};
  Image<Rgb8> from_{kFrameWidth, kFrameHeight}, to_{kFrameWidth, kFrameHeight};
  FramePair pair_{.rays = PixelRays(camera_), .to_rays = PixelRays(camera_), .noise = {.a_m = 0.002F, .b_per_m = 0.0F}};
};

const Window& Middle(const SurfaceWindows& windows) { return windows.small.cell(5, 4).front(); }

// No match at all: standing still explains nothing, and what was proposed comes first, for pixels in sight only.
TEST(FitSurfaceWindows, TakesAProposalWhereNothingExplains) {
  const MovingWall wall;
  const SurfaceWindows windows = wall.Fit(wall.Matches(0, 0), wall.Matches(kShift, 1));
  const Window& window = Middle(windows);
  ASSERT_FALSE(window.candidates.empty());
  EXPECT_NEAR(wall.ShiftOf(window, window.candidates[0].motion), kShift, 0.05);
  EXPECT_TRUE(window.candidates[0].seen_only);
}

// Matches explain the window: a proposal, here one of a motion nearby, is not even looked at.
TEST(FitSurfaceWindows, TakesNoProposalWhereMatchesExplain) {
  const MovingWall wall;
  const SurfaceWindows windows = wall.Fit(wall.Matches(kShift, 1), wall.Matches(kShift + 1, 1));
  for (const Window::Candidate& candidate : Middle(windows).candidates) EXPECT_FALSE(candidate.seen_only);
}

// Matches vote for standing still, against what colours say; the proposal has no vote, and wins by colour.
TEST(FitSurfaceWindows, TakesAProposalThatColorsConfirmAgainstMatches) {
  const MovingWall wall;
  const SurfaceWindows windows = wall.Fit(wall.Matches(0, 1), wall.Matches(kShift, 1));
  const Window& window = Middle(windows);
  bool proposed = false;
  for (const Window::Candidate& candidate : window.candidates)
    proposed = proposed || (candidate.seen_only && std::abs(wall.ShiftOf(window, candidate.motion) - kShift) < 0.05);
  EXPECT_TRUE(proposed);
}

}  // namespace
}  // namespace depthtween
