// Levels of small hand-made scenes, where it can be told by hand which points belong together.
#include "core/solve/level.h"

#include <cmath>

#include "core/solve/occlusion.h"
#include "core/solve/topology.h"
#include "gtest/gtest.h"
#include "tests/core/solve/moving_plane.h"

namespace depthtween {
namespace {

// Near on the left, far on the right of a jump inside a cell of the coarse grid: the coarse point is of the near layer.
TEST(DecimatePoints, TakesOneOfTheNearestLayer) {
  Evidence evidence{Image<Triple<float>>(16, 16), Image<Triple<float>>(16, 16), Image<float>(16, 16)};
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) evidence.point(x, y) = {0, 0, x < 7 ? 1.0F : 3.0F};
  evidence.point(12, 12) = {};
  const auto sources = DecimatePoints(evidence, {}, 3);
  ASSERT_EQ(sources.size(), 3U);
  EXPECT_EQ(sources[0](12, 12), -1);
  EXPECT_EQ(sources[1](3, 2) % 16, 6);                         // columns 6 and 7: the near one
  EXPECT_EQ(evidence.point.data()[sources[1](6, 6)].z, 3.0F);  // what is left of the cell
  EXPECT_EQ(sources[2].width(), 4);
}

// The motion of a rigid piece is carried over exactly, turn and all.
TEST(Prolong, CarriesRigidMotion) {
  const MovingPlane plane({});
  const SolveProblem problem = plane.Problem();
  const SolveOptions options{.model = MotionModel::kPerFrame};
  const IdealPixels pixels(problem.camera);
  const Evidence evidence = GatherEvidence(problem, options, pixels);
  auto sources = DecimatePoints(evidence, problem.noise, 2);
  const Level coarse = MakeLevel(problem, options, pixels, evidence, std::move(sources[1]), 2);
  const Level fine = MakeLevel(problem, options, pixels, evidence, std::move(sources[0]), 1);
  const Triple<float> turn{0.2F, -0.3F, 0.4F};
  const Rotation<float> r = RotationOf(turn);
  Planes from(coarse.data.grid, coarse.data.unknowns()), to(fine.data.grid, fine.data.unknowns());
  const int last = coarse.data.rank() - 1, turns = coarse.data.first_turn();
  for (int j = 0; j < coarse.data.grid.height; ++j)
    for (int i = 0; i < coarse.data.grid.width; ++i) {
      const ptrdiff_t at = coarse.data.grid.at(i, j);
      const Triple<float> p{coarse.data.point[0][at], coarse.data.point[1][at], coarse.data.point[2][at]};
      const Triple<float> d = r * p - p;
      const float values[6] = {d.x, d.y, d.z, turn.x, turn.y, turn.z};
      for (int a = 0; a < 3; ++a) from[3 * last + a][at] = values[a], from[turns + 3 * last + a][at] = values[3 + a];
    }
  Prolong(coarse, from, evidence, problem.noise, fine, to);
  for (int j = 0; j < fine.data.grid.height; ++j)
    for (int i = 0; i < fine.data.grid.width; ++i) {
      const ptrdiff_t at = fine.data.grid.at(i, j);
      const Triple<float> p{fine.data.point[0][at], fine.data.point[1][at], fine.data.point[2][at]};
      const Triple<float> d = r * p - p;
      EXPECT_NEAR(to[3 * last][at], d.x, 1e-4);
      EXPECT_NEAR(to[3 * last + 2][at], d.z, 1e-4);
      EXPECT_NEAR(to[turns + 3 * last + 1][at], turn.y, 1e-5);
    }
}

// Half of a wall moves away sideways, the tracks say: the edges between the halves are cut, all others stay.
TEST(CutTorn, CutsBetweenWhatParts) {
  MovingPlane plane({.turn = {0, 0, 0}, .travel = {0, 0, 0}});
  const int half = plane.track(0).width() / 2;
  for (int s = 1; s <= 4; ++s)
    for (int j = 0; j < plane.track(s).height(); ++j)
      for (int i = half; i < plane.track(s).width() - 4; ++i) plane.track(s)(i, j).u += static_cast<float>(s);
  const SolveProblem problem = plane.Problem();
  const SolveOptions options{.occlusion = false};
  const IdealPixels pixels(problem.camera);
  // Colours do not follow the tracks here: any will do.
  const Image<Rgb8> grey(48, 40, Rgb8{90, 90, 90});
  SolveProblem plain = problem;
  plain.key.color = plain.other.color = grey;
  const PartnerSurface other{plain.other.depth_m, plain.other.color, &pixels, plain.noise, plain.step};
  const Evidence evidence = GatherEvidence(plain, options, pixels);
  Level level = MakeLevel(plain, options, pixels, evidence, std::move(DecimatePoints(evidence, plain.noise, 1)[0]), 1);
  Planes unknowns(level.data.grid, level.data.unknowns());
  StartFromTracks(plain, evidence, other, level, unknowns);
  Associate(plain, options, pixels, evidence, other, unknowns, level);
  Level printed =
      MakeLevel(plain, options, pixels, evidence, std::move(DecimatePoints(evidence, plain.noise, 1)[0]), 1);
  Associate(plain, options, pixels, evidence, other, unknowns, printed);
  EXPECT_GT(CutTorn(plain, pixels, evidence, level), 0);
  EXPECT_EQ(level.data.strain[0][level.data.grid.at(half - 1, 10)], 0);
  EXPECT_GT(level.data.strain[0][level.data.grid.at(half - 4, 10)], 0);
  EXPECT_GT(level.data.strain[1][level.data.grid.at(half, 10)], 0);
  // As printed: what parts is all but cut, what stays keeps its weight.
  const Grid& grid = level.data.grid;
  EXPECT_GT(WeighTopologyAsPrinted(evidence, printed), 0);
  EXPECT_LT(printed.data.strain[0][grid.at(half - 1, 10)], 0.01F * printed.data.strain[0][grid.at(half - 4, 10)]);
  EXPECT_NEAR(printed.data.strain[0][grid.at(half - 4, 10)], level.data.strain[0][grid.at(half - 4, 10)],
              1e-3F * level.data.strain[0][grid.at(half - 4, 10)]);
}

// Closed forms: nothing wrong gives full trust; each test by itself takes it.
TEST(VisibleWeight, EachSignOfOcclusionCounts) {
  EXPECT_EQ(VisibleWeight({3, 0}, {-3, 0}, 0.5F, 0), 1);  // positive divergence uncovers
  EXPECT_LT(VisibleWeight({3, 0}, {-3, 0}, -1.0F, 0), 0.05F);
  EXPECT_LT(VisibleWeight({3, 0}, {0, 0}, 0, 0), 0.01F);
  EXPECT_LT(VisibleWeight({3, 0}, {-3, 0}, 0, 0.2F), 0.01F);
  EXPECT_EQ(JumpWeight(1), 0.25F);
  EXPECT_EQ(JumpWeight(9), 1);
}

// The paper's formulas, with its numbers.
TEST(PrintedWeights, AreThePapers) {
  EXPECT_NEAR(PrintedVisibleWeight(0.5F, 0), std::exp(-0.25), 1e-6);
  EXPECT_EQ(PrintedVisibleWeight(-0.5F, 0), PrintedVisibleWeight(0.5F, 0));
  EXPECT_NEAR(PrintedVisibleWeight(0, 20.0F / 255.0F), std::exp(-1.0), 1e-6);
  EXPECT_NEAR(PrintedTopologyWeight(0.01F, 0.025F), std::exp(-1.0), 1e-5);
}

// w = w_d w_c, and E_rigid in metres does not ask how long an edge is.
TEST(PrintedWeights, OfEdges) {
  const MovingPlane plane({.turn = {0, 0, 0}, .travel = {0, 0, 0}});
  SolveProblem problem = plane.Problem();
  Image<Rgb8> color(48, 40, Rgb8{90, 90, 90});
  for (int y = 0; y < 40; ++y)
    for (int x = 24; x < 48; ++x) color(x, y).g = 91;
  problem.key.color = problem.other.color = color;
  const Image<float> wall(48, 40, 2.0F);
  problem.key.depth_m = problem.other.depth_m = wall;
  problem.camera.fx = problem.camera.fy = 600;  // edges of some millimetres
  SolveOptions options;
  ASSERT_TRUE(options.TakeLiterally("coherence").ok());
  ASSERT_TRUE(options.TakeLiterally("rigid").ok());
  const IdealPixels pixels(problem.camera);
  const Evidence evidence = GatherEvidence(problem, options, pixels);
  const Level level =
      MakeLevel(problem, options, pixels, evidence, std::move(DecimatePoints(evidence, problem.noise, 1)[0]), 1);
  const EnergyData& data = level.data;
  const float over2 = 1.0F / (options.edge_sigma_m * options.edge_sigma_m);
  for (const int i : {4, 11}) {  // the second edge leads to the other colour
    const ptrdiff_t at = data.grid.at(i, 10);
    double length2 = 0;
    for (int axis = 0; axis < 3; ++axis) length2 += std::pow(data.point[axis][at + 1] - data.point[axis][at], 2);
    const double expected = std::exp(-length2 / (0.015 * 0.015) - (i == 11 ? 1.0 : 0.0)) * over2;
    ASSERT_GT(expected, 0.1 * over2);
    EXPECT_NEAR(data.strain[0][at], expected, 1e-3 * expected) << i;
  }
}

TEST(Torn, OnlyBeyondLengthAndNoise) {
  EXPECT_FALSE(Torn(0.01F, 0.014F, 0.0001F));
  EXPECT_TRUE(Torn(0.01F, 0.016F, 0.0001F));
  EXPECT_FALSE(Torn(0.01F, 0.016F, 0.002F));  // noise alone may do that
}

}  // namespace
}  // namespace depthtween
