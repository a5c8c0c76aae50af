// Surfaces of keys on planes that move by known amounts.
#include "core/upsample/key_surface.h"

#include <cmath>
#include <vector>

#include "gtest/gtest.h"
#include "tests/core/solve/moving_plane.h"

namespace depthtween {
namespace {

// Far from the border of what is drawn: largest distance, in pixels, between a pixel of frame s and where the plane's
// point truly is that is said to be seen there.
double WorstMotionPx(const MovingPlane& plane, const KeySurface& surface, int s) {
  const Image<Flow2> motion = surface.MotionSeenIn(s - 1);
  const Camera& camera = plane.camera();
  double worst = 0;
  for (int y = 8; y + 8 < motion.height(); ++y)
    for (int x = 8; x + 8 < motion.width(); ++x) {
      const Flow2 m = motion(x, y);
      const Triple<double> p = plane.PointAt(s, x + m.u, y + m.v);
      worst = std::max(
          {worst, std::abs(camera.fx * p.x / p.z + camera.cx - x), std::abs(camera.fy * p.y / p.z + camera.cy - y)});
    }
  return worst;
}

// Flow is exact, so both ways know where each point goes; what is left is the raster's interpolation.
TEST(KeySurface, ShowsWhereAMovingPlaneCameFrom) {
  const MovingPlane plane({});
  const KeySurface along_flow = KeySurface::AlongFlow(plane.Problem());
  const auto solved = KeySurface::Solved(plane.Problem(), {});
  ASSERT_TRUE(solved.ok()) << solved.status();
  for (int s = 1; s <= 4; ++s) {
    EXPECT_LT(WorstMotionPx(plane, along_flow, s), 0.2) << s;
    EXPECT_LT(WorstMotionPx(plane, *solved, s), 0.2) << s;
  }
  EXPECT_FALSE(along_flow.summary().has_value());
  ASSERT_TRUE(solved->summary().has_value());
  EXPECT_EQ(solved->summary()->points, 24 * 20);
}

// Depth alone: nothing says how the plane moves but the other key's surface, and it does not slide along it much.
TEST(KeySurface, WithoutFlowItIsSolvedForFromStandingStill) {
  const MovingPlane plane({.turn = {0, 0, 0}, .travel = {0, 0, -0.1}});
  SolveProblem problem = plane.Problem();
  for (SolveFrame& frame : problem.frames) frame.forward = frame.back = {};
  SolveOptions options{.outer_iterations = 5};
  options.weights.opti = options.weights.proj = 0;
  const auto solved = KeySurface::Solved(problem, options);
  ASSERT_TRUE(solved.ok()) << solved.status();
  const DrawnSurface seen = solved->SeenIn(3);
  const float truth = plane.Problem().other.depth_m(24, 20);
  EXPECT_NEAR(seen.depth_m(24, 20), truth, 0.004F);
  EXPECT_GT(std::abs(plane.Problem().key.depth_m(24, 20) - truth), 0.09F);
}

// A square goes to the right before a wall: it hides the wall where it lands, and where it was nothing is known to have
// moved.
TEST(KeySurface, TheNearerSurfaceHidesTheFarther) {
  constexpr int kSize = 40, kFirst = 10, kLast = 20, kStepPx = 2, kFrames = 3;
  const auto depth_at = [&](int moved) {
    Image<float> depth(kSize, kSize);
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x) {
        const bool inside = x >= kFirst + moved && x < kLast + moved && y >= kFirst && y < kLast;
        depth(x, y) = inside ? 1.0F : 3.0F;
      }
    return depth;
  };
  const Image<float> key = depth_at(0), other = depth_at(kStepPx * kFrames);
  const Image<Rgb8> color(kSize, kSize);
  const Image<uint8_t> luma(kSize, kSize);
  std::vector<Image<Flow2>> forward;
  for (int s = 0; s < kFrames; ++s) {
    const Image<float> depth = depth_at(kStepPx * s);
    forward.emplace_back(kSize, kSize);
    for (size_t p = 0; p < depth.pixel_count(); ++p)
      if (depth.data()[p] < 2) forward.back().data()[p] = {kStepPx, 0};
  }
  SolveProblem path{.camera = {.width = kSize, .height = kSize, .fx = 40, .fy = 40, .cx = 19.5, .cy = 19.5},
                    .key = {key, color, luma},
                    .other = {other, color, luma},
                    .noise = {.a_m = 0.001F, .b_per_m = 0.0004F}};
  for (int s = 0; s < kFrames; ++s)
    path.frames.push_back({.time = static_cast<float>(s + 1) / kFrames, .luma = luma, .forward = forward[s]});
  const Image<Flow2> motion = KeySurface::AlongFlow(path).MotionSeenIn(kFrames - 1);
  const int moved = kStepPx * kFrames;
  for (int y = kFirst + 1; y < kLast - 2; ++y) {
    for (int x = kFirst + moved + 1; x < kLast + moved - 2; ++x) EXPECT_NEAR(motion(x, y).u, -moved, 0.01) << x;
    for (int x = kLast + moved + 2; x < kSize - 2; ++x) EXPECT_NEAR(motion(x, y).u, 0, 0.01) << x;
    for (int x = kFirst + 1; x < kFirst + moved - 2; ++x) EXPECT_EQ(motion(x, y).u, 0) << "uncovered " << x;
  }
}

TEST(KeySurface, SaysWhatIsWrongWithASolve) {
  const MovingPlane plane({});
  EXPECT_EQ(KeySurface::Solved(plane.Problem(), {.levels = 0}).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace depthtween
