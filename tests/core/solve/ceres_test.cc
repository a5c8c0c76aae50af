// Our minimiser against Ceres on the same frozen energies.
#include <random>
#include <string>
#include <vector>

#include "core/options/upsample_options.h"
#include "core/solve/energy.h"
#include "core/solve/level.h"
#include "gtest/gtest.h"
#include "tests/core/solve/ceres_energy.h"
#include "tests/core/solve/moving_plane.h"
#include "tests/core/solve/some_level.h"

namespace depthtween {
namespace {

class CeresTest : public ::testing::TestWithParam<MotionModel> {};

TEST_P(CeresTest, CountsTheSameEnergy) {
  Planes unknowns;
  const Level level = HardLevel({.model = GetParam()}, 0.01F, unknowns);
  CeresEnergy energy(level.data, unknowns);
  EXPECT_NEAR(CostOf(level.data, unknowns), energy.Cost(), 1e-4 * energy.Cost());
}

// Each choice of the paper taken literally, and all of them: what Ceres sums is written down independently.
TEST_P(CeresTest, CountsTheSameEnergyAsPrinted) {
  std::vector<std::vector<std::string>> sets = {LiteralNames()};
  for (const std::string& choice : LiteralNames()) sets.push_back({choice});
  double built = 0;
  for (const std::vector<std::string>& choices : sets) {
    SolveOptions options{.model = GetParam()};
    for (const std::string& choice : choices) ASSERT_TRUE(options.TakeLiterally(choice).ok());
    Planes unknowns;
    const Level level = HardLevel(options, 0.01F, unknowns);
    CeresEnergy energy(level.data, unknowns);
    EXPECT_NEAR(CostOf(level.data, unknowns), energy.Cost(), 1e-4 * energy.Cost()) << choices[0];
    EXPECT_NE(energy.Cost(), built) << choices[0];
  }
}

TEST_P(CeresTest, FindsTheSameMinimum) {
  Planes unknowns;
  const Level level = HardLevel({.model = GetParam()}, 0.01F, unknowns);
  CeresEnergy energy(level.data, unknowns);
  const double start = energy.Cost();
  std::string termination;
  const SolveLevelSummary ours = Minimise(level.data, 60, 200, unknowns, termination);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 200;
  options.logging_type = ceres::SILENT;
  const ceres::Solver::Summary theirs = energy.Minimise(options);
  ASSERT_TRUE(theirs.IsSolutionUsable()) << theirs.BriefReport();
  ASSERT_LT(energy.Cost(), 0.2 * start) << "there was nothing to do";
  EXPECT_NEAR(ours.last_cost, energy.Cost(), 0.01 * energy.Cost()) << termination << "; " << theirs.BriefReport();
}

// Of terms without a kernel, where both build the same matrix: rotations count as they are, far from rest too.
TEST_P(CeresTest, MultipliesByTheSameMatrix) {
  SolveOptions options{.model = GetParam()};
  for (const char* part : {"opti", "point", "plane", "proj"}) ASSERT_TRUE(options.SwitchOff(part).ok());
  Planes unknowns;
  const Level level = HardLevel(options, 0.3F, unknowns);
  const Grid& grid = level.data.grid;
  Linearisation here(level.data);
  Linearise(level.data, unknowns, here);
  NormalMatrix matrix(level.data, unknowns, here);
  CeresEnergy energy(level.data, unknowns);
  std::mt19937 random(5);
  std::normal_distribution<float> normal;
  for (int only = 0; only < 3; ++only) {  // motions, rotations, both
    Planes x(grid, level.data.unknowns()), scratch = x.Clone(), image = x.Clone();
    for (int k = 0; k < level.data.unknowns(); ++k)
      for (int j = 0; j < grid.height; ++j)
        for (int i = 0; i < grid.width; ++i)
          if (only == 2 || (k < level.data.first_turn()) == (only == 0)) x[k][grid.at(i, j)] = normal(random);
    const double curvature = energy.Curvature(x);
    EXPECT_NEAR(matrix.Apply(x, 0, scratch, image), curvature, 1e-4 * curvature) << only;
  }
}

INSTANTIATE_TEST_SUITE_P(Models, CeresTest, ::testing::Values(MotionModel::kTrajectory, MotionModel::kPerFrame));

}  // namespace
}  // namespace depthtween
