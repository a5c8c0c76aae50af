// Our minimiser against Ceres on the same frozen energies.
#include <string>

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

INSTANTIATE_TEST_SUITE_P(Models, CeresTest, ::testing::Values(MotionModel::kTrajectory, MotionModel::kPerFrame));

}  // namespace
}  // namespace depthtween
