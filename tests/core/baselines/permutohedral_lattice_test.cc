// The lattice against the Gaussian filter it approximates, summed directly.
#include "core/baselines/permutohedral_lattice.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

struct Points {
  int dimension = 0;
  std::vector<float> positions;  // dimension of each point, sigmas
  std::vector<float> values;

  int count() const { return static_cast<int>(values.size()); }
  const float* at(int i) const { return positions.data() + static_cast<size_t>(i) * dimension; }
};

// A cloud that fills the space densely enough for every corner of the lattice to be there: a sparse one loses the
// weight that would have passed over missing corners.
Points Cloud(int dimension, int count, float extent, int seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> place(-extent, extent);
  Points points{.dimension = dimension};
  for (int i = 0; i < count; ++i) {
    float wave = 0;
    for (int k = 0; k < dimension; ++k) {
      points.positions.push_back(place(random));
      wave += std::sin(1.3F * points.positions.back() + static_cast<float>(k));
    }
    points.values.push_back(2.0F + wave / static_cast<float>(dimension));
  }
  return points;
}

// Weighted mean at each point, by the lattice.
std::vector<float> Filtered(const Points& points) {
  PermutohedralLattice lattice(points.dimension, 2);
  for (int i = 0; i < points.count(); ++i) {
    const float value[2] = {points.values[i], 1.0F};
    lattice.Splat(lattice.AddPoint(points.at(i)), value);
  }
  lattice.Blur();
  std::vector<float> out;
  for (int i = 0; i < points.count(); ++i) {
    float sums[2];
    lattice.Slice(i, sums);
    EXPECT_GT(sums[1], 0.0F) << "a point's own weight comes back to it";
    out.push_back(sums[0] / sums[1]);
  }
  return out;
}

// The same by definition: sum over all pairs with exp(-d^2 / 2).
std::vector<float> BruteForce(const Points& points) {
  std::vector<float> out;
  for (int i = 0; i < points.count(); ++i) {
    double sum = 0, weight = 0;
    for (int j = 0; j < points.count(); ++j) {
      double distance2 = 0;
      for (int k = 0; k < points.dimension; ++k) {
        const double d = points.at(i)[k] - points.at(j)[k];
        distance2 += d * d;
      }
      const double w = std::exp(-0.5 * distance2);
      sum += w * points.values[j], weight += w;
    }
    out.push_back(static_cast<float>(sum / weight));
  }
  return out;
}

float RootMeanSquare(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return static_cast<float>(std::sqrt(sum / static_cast<double>(a.size())));
}

// The oracle is the Gaussian filter by its definition. The lattice's kernel has its variance and differs in shape by a
// few per cent, so means over a cloud must come near: within a fifth of what the filter changes at all.
TEST(PermutohedralLattice, FiltersAsTheGaussianDoes) {
  for (const auto& [dimension, count, extent] : {std::tuple{1, 400, 5.0F}, {2, 2500, 4.0F}, {3, 4000, 2.5F}}) {
    const Points points = Cloud(dimension, count, extent, 7);
    const std::vector<float> truth = BruteForce(points), found = Filtered(points);
    const float changed = RootMeanSquare(points.values, truth);
    ASSERT_GT(changed, 0.1F) << "the filter must have something to do";
    EXPECT_LT(RootMeanSquare(found, truth), 0.2F * changed) << dimension << " dimensions";
  }
}

// The mean of a constant is that constant, and a mean lies between the values it is of: weights are never negative.
TEST(PermutohedralLattice, IsAMean) {
  Points points = Cloud(6, 600, 2.0F, 3);
  const auto [least, most] = std::minmax_element(points.values.begin(), points.values.end());
  for (const float value : Filtered(points)) {
    EXPECT_GE(value, *least - 1e-4F);
    EXPECT_LE(value, *most + 1e-4F);
  }
  std::fill(points.values.begin(), points.values.end(), 1.75F);
  for (const float value : Filtered(points)) EXPECT_NEAR(value, 1.75F, 1e-5F);
}

// Reading at a point's own position is reading the point; where no point ever was, there is nothing.
TEST(PermutohedralLattice, ReadsAnywhere) {
  const Points points = Cloud(6, 50, 1.0F, 5);
  PermutohedralLattice lattice(6, 1);
  for (int i = 0; i < points.count(); ++i) lattice.Splat(lattice.AddPoint(points.at(i)), &points.values[i]);
  lattice.Blur();
  for (int i = 0; i < points.count(); ++i) {
    float slice, anywhere;
    lattice.Slice(i, &slice);
    lattice.SliceAt(points.at(i), &anywhere);
    EXPECT_FLOAT_EQ(slice, anywhere);
  }
  const float far[6] = {100, 100, 100, 100, 100, 100};
  float nothing;
  lattice.SliceAt(far, &nothing);
  EXPECT_EQ(nothing, 0.0F);
}

// Two clusters many sigmas apart do not see each other.
TEST(PermutohedralLattice, KeepsDistantPointsApart) {
  Points points{.dimension = 3};
  for (int i = 0; i < 40; ++i) {
    const float side = i % 2 == 0 ? -6.0F : 6.0F;
    points.positions.insert(points.positions.end(), {side, 0.1F * static_cast<float>(i), 0.0F});
    points.values.push_back(side < 0 ? 1.0F : 3.0F);
  }
  const std::vector<float> means = Filtered(points);
  for (int i = 0; i < points.count(); ++i) EXPECT_FLOAT_EQ(means[i], points.values[i]);
}

}  // namespace
}  // namespace depthtween
