// The gradient of the whole energy against differences of its value, at unknowns away from the minimum. The value is a
// sum of single-precision costs, so steps are large and tolerances relative.
#include "core/solve/energy.h"

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "core/options/upsample_options.h"
#include "core/solve/level.h"
#include "gtest/gtest.h"
#include "tests/core/solve/moving_plane.h"
#include "tests/core/solve/some_level.h"

namespace depthtween {
namespace {

// In every combination of model and single term, and with all of them together.
TEST(Energy, GradientIsTheSlopeOfTheValue) {
  const MovingPlane plane({.width = 22, .height = 18});
  for (const MotionModel model : {MotionModel::kTrajectory, MotionModel::kPerFrame})
    for (int only = -2; only < 7; ++only) {  // -2: with every choice as printed
      SolveOptions options{.model = model};
      for (const std::string& choice : only == -2 ? LiteralNames() : std::vector<std::string>())
        ASSERT_TRUE(options.TakeLiterally(choice).ok());
      if (only >= 0) {
        float* terms[7] = {&options.weights.opti,    &options.weights.point, &options.weights.plane,
                           &options.weights.proj,    &options.weights.rigid, &options.weights.reg,
                           &options.weights.shortest};
        for (int t = 0; t < 7; ++t)
          if (t != only) *terms[t] = 0;
      }
      Planes unknowns;
      const Level level = SomeLevel(plane, options, unknowns);
      const EnergyData& data = level.data;
      const Grid& grid = data.grid;
      std::mt19937 random(7);
      std::normal_distribution<float> normal;
      Planes direction(grid, data.unknowns());
      for (int k = 0; k < data.unknowns(); ++k)
        for (int j = 0; j < grid.height; ++j)
          for (int i = 0; i < grid.width; ++i) {
            unknowns[k][grid.at(i, j)] += 0.02F * normal(random);
            direction[k][grid.at(i, j)] = normal(random);
          }
      Linearisation here(data);
      Linearise(data, unknowns, here);
      double slope = 0;
      for (int k = 0; k < data.unknowns(); ++k)
        for (int j = 0; j < grid.height; ++j)
          for (int i = 0; i < grid.width; ++i)
            slope += 2.0 * here.gradient[k][grid.at(i, j)] * direction[k][grid.at(i, j)];
      const auto moved = [&](float by) {
        Planes there = unknowns.Clone();
        for (int k = 0; k < data.unknowns(); ++k)
          for (size_t i = 0; i < grid.size(); ++i) there[k][i] += by * direction[k][i];
        return CostOf(data, there);
      };
      constexpr float kStep = 2e-4F;
      const double difference = (moved(kStep) - moved(-kStep)) / (2.0 * kStep);
      EXPECT_NEAR(slope, difference, 0.01 * std::abs(difference) + 1e-4 * here.cost)
          << "term " << only << ", model " << static_cast<int>(model);
      EXPECT_GT(here.cost, 0);
    }
}

// The matrix is symmetric and positive, and the preconditioner too: else conjugate gradients mean nothing.
TEST(Energy, MatrixAndPreconditionerAreSymmetricAndPositive) {
  const MovingPlane plane({.width = 22, .height = 18});
  for (const MotionModel model : {MotionModel::kTrajectory, MotionModel::kPerFrame}) {
    Planes unknowns;
    const Level level = SomeLevel(plane, {.model = model}, unknowns);
    const EnergyData& data = level.data;
    const Grid& grid = data.grid;
    std::mt19937 random(11);
    std::normal_distribution<float> normal;
    for (int k = data.first_turn(); k < data.unknowns(); ++k)
      for (int j = 0; j < grid.height; ++j)
        for (int i = 0; i < grid.width; ++i) unknowns[k][grid.at(i, j)] = 0.1F * normal(random);
    Linearisation here(data);
    Linearise(data, unknowns, here);
    NormalMatrix matrix(data, unknowns, here);
    const Preconditioner preconditioner(matrix);
    Planes a(grid, data.unknowns()), b(grid, data.unknowns()), out_a(grid, data.unknowns()),
        out_b(grid, data.unknowns());
    for (int k = 0; k < data.unknowns(); ++k)
      for (int j = 0; j < grid.height; ++j)
        for (int i = 0; i < grid.width; ++i) a[k][grid.at(i, j)] = normal(random), b[k][grid.at(i, j)] = normal(random);
    const auto dot = [&](const Planes& x, const Planes& y) {
      double sum = 0;
      for (int k = 0; k < data.unknowns(); ++k)
        for (int j = 0; j < grid.height; ++j)
          for (int i = 0; i < grid.width; ++i) sum += static_cast<double>(x[k][grid.at(i, j)]) * y[k][grid.at(i, j)];
      return sum;
    };
    const Planes nothing(grid, data.unknowns());
    Planes step = nothing.Clone(), x = nothing.Clone();
    const double aha = matrix.Apply(a, 0, x, out_a);
    const double bhb = matrix.Apply(b, 0, x, out_b);
    EXPECT_GT(aha, 0);
    EXPECT_NEAR(aha, dot(a, out_a), 1e-4 * aha);
    EXPECT_NEAR(dot(b, out_a), dot(a, out_b), 1e-4 * std::sqrt(aha * bhb));
    const double ama = preconditioner.Apply(0, nothing, nothing, step, a, out_a);
    const double bmb = preconditioner.Apply(0, nothing, nothing, step, b, out_b);
    EXPECT_GT(ama, 0);
    EXPECT_NEAR(dot(b, out_a), dot(a, out_b), 1e-3 * std::sqrt(ama * bmb));
  }
}

}  // namespace
}  // namespace depthtween
