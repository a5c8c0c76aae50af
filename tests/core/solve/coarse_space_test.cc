// The coarse space of the preconditioner, against what it is defined by.
#include "core/solve/coarse_space.h"

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "core/solve/level.h"
#include "gtest/gtest.h"
#include "tests/core/solve/moving_plane.h"
#include "tests/core/solve/some_level.h"

namespace depthtween {
namespace {

double ProductOf(const Planes& a, const Planes& b, const Grid& grid) {
  double sum = 0;
  for (int k = 0; k < a.count(); ++k)
    for (int j = 0; j < grid.height; ++j)
      for (int i = 0; i < grid.width; ++i) sum += static_cast<double>(a[k][grid.at(i, j)]) * b[k][grid.at(i, j)];
  return sum;
}

// B = A A^T + 1 has twice the band of a lower triangular A, and B (B^-1 b) = b.
TEST(BlockBand, SolvesWhatItFactors) {
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  for (const auto& [blocks, reach] : {std::pair{1, 0}, {2, 1}, {7, 3}, {5, 9}}) {
    const int size = blocks * kRigid;
    std::vector<std::vector<double>> a(size, std::vector<double>(size)), b = a;
    for (int i = 0; i < size; ++i)
      for (int j = std::max(0, i / kRigid - reach / 2) * kRigid; j <= i; ++j) a[i][j] = normal(random);
    BlockBand matrix(blocks, reach);
    for (int i = 0; i < size; ++i)
      for (int j = 0; j < size; ++j) {
        for (int k = 0; k < size; ++k) b[i][j] += a[i][k] * a[j][k];
        if (i == j) b[i][j] += 1;
        if (i / kRigid >= j / kRigid && i / kRigid <= j / kRigid + reach)
          matrix.Block(i / kRigid, j / kRigid)[j % kRigid][i % kRigid] = static_cast<float>(b[i][j]);
      }
    std::vector<Lanes> x(blocks);
    for (int i = 0; i < size; ++i) x[i / kRigid][i % kRigid] = normal(random);
    const std::vector<Lanes> right = x;
    matrix.Factor();
    matrix.Solve(x.data());
    for (int i = 0; i < size; ++i) {
      double product = 0;
      for (int j = 0; j < size; ++j) product += b[i][j] * x[j / kRigid][j % kRigid];
      EXPECT_NEAR(product, right[i / kRigid][i % kRigid], 2e-3) << blocks << ", " << reach << ": " << i;
    }
  }
}

// With one frame after the key and no rotation yet nothing is left out of P^T H P: whatever lies in the space comes
// back from H x as it was. Rigid motions do, and motions linear in the grid.
TEST(CoarseSpace, SolvesForRigidMotionsExactly) {
  for (const auto& [width, height] : {std::pair{26, 36}, {52, 22}}) {
    const MovingPlane plane({.width = width, .height = height, .frames = 1});
    Planes unknowns;
    const Level level = SomeLevel(plane, {}, unknowns);
    const EnergyData& data = level.data;
    const Grid& grid = data.grid;
    ASSERT_EQ(data.rank(), 1);
    Linearisation here(data);
    Linearise(data, unknowns, here);
    NormalMatrix matrix(data, unknowns, here);
    for (const int spacing : {1, 4, 5, 9, 100}) {
      CoarseSpace coarse(data, spacing);
      coarse.Factor(matrix);
      for (const bool rigid : {true, false}) {
        Planes x(grid, 6), scratch(grid, 6), image(grid, 6), back(grid, 6);
        const Triple<float> turn{0.3F, -0.2F, 0.5F};
        for (int j = 0; j < grid.height; ++j)
          for (int i = 0; i < grid.width; ++i) {
            const ptrdiff_t at = grid.at(i, j);
            const Triple<float> p{data.point[0][at], data.point[1][at], data.point[2][at] - 2};
            const auto u = static_cast<float>(i), v = static_cast<float>(j);
            const Triple<float> move = rigid ? Triple<float>{0.2F, 0.1F, -0.3F} + Cross(turn, p)
                                             : Triple<float>{0.02F * u, 0.01F * v - 0.01F * u, 0.03F * v};
            x[0][at] = move.x, x[1][at] = move.y, x[2][at] = move.z;
            if (rigid) x[3][at] = turn.x, x[4][at] = turn.y, x[5][at] = turn.z;
          }
        const double curvature = matrix.Apply(x, 0, scratch, image);
        EXPECT_NEAR(coarse.Correct(image, back), curvature, 0.01 * curvature) << spacing << ", rigid " << rigid;
        for (int k = 0; k < 6; ++k)
          for (int j = 0; j < grid.height; ++j)
            for (int i = 0; i < grid.width; ++i)
              ASSERT_NEAR(back[k][grid.at(i, j)], x[k][grid.at(i, j)], 0.02)
                  << spacing << ", rigid " << rigid << ": " << k << " of " << i << ", " << j;
      }
    }
  }
}

// Else conjugate gradients mean nothing. Points that do not exist, and what lies beyond the grid, are not touched.
TEST(CoarseSpace, IsSymmetricAndPositive) {
  MovingPlane plane({.width = 42, .height = 18});
  for (int y = 4; y < 9; ++y)
    for (int x = 0; x < 22; ++x) plane.depth(0)(x, y) = 0;
  for (const MotionModel model : {MotionModel::kTrajectory, MotionModel::kPerFrame}) {
    Planes unknowns;
    const Level level = SomeLevel(plane, {.model = model}, unknowns);
    const EnergyData& data = level.data;
    const Grid& grid = data.grid;
    std::mt19937 random(11);
    std::normal_distribution<float> normal;
    Planes a(grid, data.unknowns()), b = a.Clone(), out_a = a.Clone(), out_b = a.Clone();
    int missing = 0;
    for (int j = 0; j < grid.height; ++j)
      for (int i = 0; i < grid.width; ++i) {
        const bool exists = data.exists[0][grid.at(i, j)] > 0;
        missing += !exists;
        for (int k = 0; k < data.unknowns(); ++k) {
          if (k >= data.first_turn()) unknowns[k][grid.at(i, j)] = 0.1F * normal(random);
          if (exists) a[k][grid.at(i, j)] = normal(random), b[k][grid.at(i, j)] = normal(random);
        }
      }
    ASSERT_GT(missing, 20);
    Linearisation here(data);
    Linearise(data, unknowns, here);
    const NormalMatrix matrix(data, unknowns, here);
    CoarseSpace coarse(data, 4);
    coarse.Factor(matrix);
    const double aca = coarse.Correct(a, out_a), bcb = coarse.Correct(b, out_b);
    EXPECT_GT(aca, 0);
    EXPECT_GT(bcb, 0);
    EXPECT_NEAR(aca, ProductOf(a, out_a, grid), 1e-3 * aca);
    EXPECT_NEAR(ProductOf(b, out_a, grid), ProductOf(a, out_b, grid), 1e-3 * std::sqrt(aca * bcb));
    for (int k = 0; k < data.unknowns(); ++k) {
      double all = 0, existing = 0;
      for (size_t i = 0; i < grid.size(); ++i)
        all += std::abs(out_a[k][i]), existing += data.exists[0][i] > 0 ? std::abs(out_a[k][i]) : 0.0F;
      EXPECT_EQ(all, existing) << k;
    }
  }
}

// What it is for: block-Jacobi alone needs two hundred conjugate steps and more to come within 1 % of the least here.
TEST(CoarseSpace, MakesFewStepsEnough) {
  for (const MotionModel model : {MotionModel::kTrajectory, MotionModel::kPerFrame})
    for (const auto& [width, height] : {std::pair{13, 11}, {33, 21}}) {
      Planes start;
      const Level level = HardLevel({.model = model}, 0.01F, start, width, height);
      std::string termination;
      Planes unknowns = start.Clone();
      const double least = Minimise(level.data, 60, 500, unknowns, termination).last_cost;
      unknowns = start.Clone();
      const SolveLevelSummary summary = Minimise(level.data, 2, 500, unknowns, termination);
      EXPECT_LT(summary.last_cost, 1.01 * least) << width;
      EXPECT_LT(summary.conjugate_steps, 50) << width;
    }
}

}  // namespace
}  // namespace depthtween
