// The joint solve on planes whose motion is known in closed form.
#include "core/solve/solve.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/options/upsample_options.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/solve/moving_plane.h"

namespace depthtween {
namespace {

// Largest distance of a point from where it truly is in frame s (1..), away from the border.
double WorstError(const MovingPlane& plane, const SolvedMotion& motion, int s, int step) {
  const Grid& grid = motion.data().grid;
  double worst = 0;
  for (int j = 2; j + 2 < grid.height; ++j)
    for (int i = 2; i + 2 < grid.width; ++i) {
      const Triple<float> p = motion.PointAt(i, j), d = motion.MotionOf(i, j, s - 1);
      const Triple<double> truth = plane.PointAt(s, i * step, j * step);
      const Triple<double> error = Triple<double>{p.x + d.x, p.y + d.y, p.z + d.z} - truth;
      const double length = std::sqrt(Dot(error, error));
      if (!(length <= worst)) worst = length;  // NaN counts
    }
  return worst;
}

// All residuals vanish for the true motion, but for the pull of the printed short term and the grain of 8-bit images:
// a millimetre of 2 m.
TEST(Solve, FindsATurningPlane) {
  const MovingPlane plane({});
  for (const MotionModel model : {MotionModel::kTrajectory, MotionModel::kPerFrame}) {
    const auto result = Solve(plane.Problem(), {.model = model, .newton_iterations = 4, .conjugate_iterations = 30});
    ASSERT_TRUE(result.ok()) << result.status();
    for (int s = 1; s <= 4; ++s) EXPECT_LT(WorstError(plane, result->motion, s, 2), 2e-3) << s;
    EXPECT_EQ(result->summary.points, 24 * 20);
    EXPECT_GT(result->summary.partners, 24 * 20 / 2);
    ASSERT_EQ(result->summary.levels.size(), 3U);
    for (const SolveLevelSummary& level : result->summary.levels) EXPECT_LE(level.last_cost, level.first_cost);
    EXPECT_NE(result->summary.termination, SolveSummary().termination);
  }
}

// The paper's schedule takes the steps it names on every level and finds the plane, too: the truth is its pose.
TEST(Solve, ReferenceTakesThePapersSchedule) {
  const MovingPlane plane({});
  const auto result = Solve(plane.Problem(), SolveOptions::Reference());
  ASSERT_TRUE(result.ok()) << result.status();
  ASSERT_EQ(result->summary.levels.size(), 3U);
  for (const SolveLevelSummary& level : result->summary.levels) {
    EXPECT_LE(level.newton_steps, 5);
    EXPECT_GE(level.newton_steps, 1);
    EXPECT_LE(level.conjugate_steps, 5 * 10);
  }
  EXPECT_EQ(result->motion.data().rank(), 4);
  for (int s = 1; s <= 4; ++s) EXPECT_LT(WorstError(plane, result->motion, s, 2), 5e-3) << s;
}

// The short term asks for less acceleration than there is; it may win a tenth of a pixel, no more (a pixel: 33 mm).
TEST(Solve, FollowsAcceleration) {
  const MovingPlane plane({.bend_m = 0.1});
  const auto result = Solve(plane.Problem(), {.newton_iterations = 4, .conjugate_iterations = 30});
  ASSERT_TRUE(result.ok()) << result.status();
  for (int s = 1; s <= 4; ++s) EXPECT_LT(WorstError(plane, result->motion, s, 2), 5e-3) << s;
}

// A patch whose flow belongs to something else: rigidity and the kernel carry it along with its surface.
TEST(Solve, RigidityOverrulesWrongTracks) {
  MovingPlane plane({});
  for (int s = 1; s <= 4; ++s)
    for (int j = 8; j < 11; ++j)
      for (int i = 10; i < 13; ++i) plane.track(s)(i, j).u += 2.5F * static_cast<float>(s);
  const auto result = Solve(plane.Problem(), {.newton_iterations = 6, .conjugate_iterations = 40});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(WorstError(plane, result->motion, 4, 2), 0.02);  // the tracks lie: 0.33 m
}

// A hole in the other key, where nothing can be associated: depth there comes from the rigid surroundings.
TEST(Solve, RigidityFillsWhatTheOtherKeyDoesNotShow) {
  MovingPlane plane({});
  for (int y = 14; y < 24; ++y)
    for (int x = 18; x < 28; ++x) plane.depth(4)(x, y) = 0;
  const auto result = Solve(plane.Problem(), {.newton_iterations = 6, .conjugate_iterations = 40});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(WorstError(plane, result->motion, 4, 2), 5e-3);
}

// Every residual is measured in its own deviation, and those scale with the world: ten times the metres give ten times
// the motion, up to rounding.
TEST(Solve, AWorldTenTimesAsLarge) {
  const MovingPlane one({}), ten({.metres = 10});
  const auto small = Solve(one.Problem(), {});
  const auto large = Solve(ten.Problem(), {});
  ASSERT_TRUE(small.ok() && large.ok());
  const Grid& grid = small->motion.data().grid;
  for (int j = 0; j < grid.height; ++j)
    for (int i = 0; i < grid.width; ++i) {
      const Triple<float> a = small->motion.MotionOf(i, j, 3), b = large->motion.MotionOf(i, j, 3);
      EXPECT_NEAR(10 * a.x, b.x, 2e-3);
      EXPECT_NEAR(10 * a.y, b.y, 2e-3);
      EXPECT_NEAR(10 * a.z, b.z, 2e-3);
    }
  EXPECT_NEAR(large->summary.levels.back().first_cost / small->summary.levels.back().first_cost, 1, 0.01);
}

// One frame leaves one coefficient.
TEST(Solve, OneFrame) {
  const MovingPlane plane({.frames = 1});
  const auto result = Solve(plane.Problem(), {.newton_iterations = 4});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->motion.data().rank(), 1);
  EXPECT_LT(WorstError(plane, result->motion, 1, 2), 2e-3);
}

// Depth unknown somewhere: those points have no motion, and no NaN comes of them.
TEST(Solve, UnknownDepthIsLeftOut) {
  MovingPlane plane({});
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 48; ++x) plane.depth(0)(x, y) = 0;
  const auto result = Solve(plane.Problem(), {});
  ASSERT_TRUE(result.ok()) << result.status();
  Image<Flow2> position;
  Image<float> depth;
  result->motion.At(3, position, depth);
  for (int j = 0; j < 20; ++j)
    for (int i = 0; i < 24; ++i) {
      EXPECT_EQ(depth(i, j) > 0, j >= 6) << i << "," << j;
      EXPECT_TRUE(std::isfinite(position(i, j).u) && std::isfinite(depth(i, j)));
    }
}

// As printed E_short pulls every point to where it was before: a plane that comes nearer, of which the images tell
// little, comes less near.
TEST(Solve, ThePrintedShortTermShrinksMotion) {
  const MovingPlane plane({.turn = {0, 0, 0}, .travel = {0, 0, -0.2}});
  double moved[2] = {};
  for (const bool printed : {false, true}) {
    SolveOptions options{.newton_iterations = 4, .conjugate_iterations = 30};
    ASSERT_TRUE(options.SwitchOff("plane").ok());
    ASSERT_TRUE(options.SwitchOff("point").ok());
    options.printed.shortest = printed;
    const auto result = Solve(plane.Problem(), options);
    ASSERT_TRUE(result.ok()) << result.status();
    moved[printed] = result->motion.MotionOf(12, 10, 3).z;
  }
  EXPECT_NEAR(moved[0], -0.2, 0.01);
  EXPECT_GT(moved[1], 0.99 * moved[0]);
}

TEST(Solve, SaysWhatIsWrong) {
  const MovingPlane plane({});
  SolveProblem problem = plane.Problem();
  problem.frames[2].time = 0.1F;
  EXPECT_THAT(std::string(Solve(problem, {}).status().message()), testing::HasSubstr("frames.time = 0.1"));
  EXPECT_THAT(std::string(Solve(plane.Problem(), {.strain_sigma = 0}).status().message()),
              testing::HasSubstr("SolveOptions.strain_sigma = 0"));
  SolveOptions options;
  for (const std::string& part : SolvePartNames()) EXPECT_TRUE(options.SwitchOff(part).ok()) << part;
  EXPECT_THAT(std::string(options.SwitchOff("magic").message()), testing::HasSubstr("opti, point"));
  // Every name is known, and every choice has one.
  for (const std::string& choice : LiteralNames()) EXPECT_TRUE(options.TakeLiterally(choice).ok()) << choice;
  EXPECT_EQ(LiteralNames().size(), sizeof(PrintedChoices) / sizeof(bool));
  EXPECT_THAT(std::string(options.TakeLiterally("magic").message()), testing::HasSubstr("closest, coherence"));
}

}  // namespace
}  // namespace depthtween
