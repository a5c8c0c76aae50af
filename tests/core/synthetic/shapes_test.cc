// Rays against shapes: a walk along the ray tells where the inside begins.
#include "core/synthetic/shapes.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <tuple>
#include <vector>

#include "core/synthetic/random.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

// A ray from a random point on a sphere of radius 4 towards a random point near the origin, of random length.
Ray RandomRay(int i) {
  const auto uniform = [i](int k) { return 2 * UniformFrom(RandomBits(7, i, k)) - 1; };
  const Vec3 from = 4 * Vec3(uniform(0), uniform(1), uniform(2) + 1e-3).normalized();
  const Vec3 target(1.2 * uniform(3), 1.2 * uniform(4), 1.2 * uniform(5));
  return {from, (target - from) * (0.3 + UniformFrom(RandomBits(7, i, 6)))};
}

// A solid is known by which points are inside. The first entry is where a walk along the ray first finds one.
void ExpectFirstEntry(const Shape& shape, const std::function<bool(const Vec3&)>& inside) {
  constexpr double kStep = 2e-3;
  int hits = 0;
  for (int i = 0; i < 300; ++i) {
    const Ray ray = RandomRay(i);
    const double step = kStep / ray.direction.norm();
    double entry = -1;
    for (double s = 0; s < 8 / ray.direction.norm(); s += step)
      if (inside(ray.origin + s * ray.direction)) {
        entry = s;
        break;
      }
    ShapeHit hit;
    const bool met = shape.Intersect(ray, 1e9, &hit);
    if (entry < 0) {
      // A walk may step over a corner thinner than its step.
      if (met) {
        EXPECT_FALSE(inside(ray.origin + (hit.s + 2 * step) * ray.direction)) << "ray " << i;
      }
      continue;
    }
    ++hits;
    ASSERT_TRUE(met) << "ray " << i;
    EXPECT_LE(hit.s, entry + 1e-9) << "ray " << i;
    EXPECT_GE(hit.s, entry - step - 1e-9) << "ray " << i;
    EXPECT_LT(hit.normal.dot(ray.direction), 0) << "ray " << i;
    EXPECT_NEAR((shape.Locate(hit.material) - (ray.origin + hit.s * ray.direction)).norm(), 0, 1e-9);
    EXPECT_TRUE(shape.Bounds().contains(Vec3(0.999999 * hit.material)));
    EXPECT_FALSE(shape.Intersect(ray, 0.999 * hit.s, &hit)) << "beyond s_max, ray " << i;
  }
  EXPECT_GT(hits, 25);
}

TEST(Box, IsMetWhereItsInsideBegins) {
  const Vec3 half(0.5, 0.8, 0.3);
  ExpectFirstEntry(Box(half), [&](const Vec3& p) { return (p.cwiseAbs() - half).maxCoeff() <= 0; });
}

TEST(Ellipsoid, IsMetWhereItsInsideBegins) {
  const Vec3 radii(0.9, 0.5, 0.7);
  ExpectFirstEntry(Ellipsoid(radii), [&](const Vec3& p) { return p.cwiseQuotient(radii).squaredNorm() <= 1; });
}

TEST(Cylinder, IsMetWhereItsInsideBegins) {
  ExpectFirstEntry(Cylinder(0.6, 0.8),
                   [](const Vec3& p) { return p.head<2>().norm() <= 0.6 && std::abs(p.z()) <= 0.8; });
}

// The hull of two balls is the union of all balls between them; the one that reaches farthest around a point sits where
// the distance to the axis leaves the axis at the cone's angle.
TEST(RoundCone, IsMetWhereItsInsideBegins) {
  for (const auto& [length, a, b] : {std::tuple{0.9, 0.5, 0.2}, std::tuple{0.8, 0.3, 0.3}, std::tuple{0.7, 0.2, 0.45}})
    ExpectFirstEntry(RoundCone(length, a, b), [length = length, a = a, b = b](const Vec3& p) {
      const double sine = (a - b) / length;
      const double foot = p.z() - p.head<2>().norm() * sine / std::sqrt(1 - sine * sine);
      const double share = std::clamp(foot / length, 0.0, 1.0);
      return (p - Vec3(0, 0, share * length)).norm() <= a + share * (b - a);
    });
}

// A rod seen along its own axis is its end's ball.
TEST(RoundCone, IsMetHeadOn) {
  ShapeHit hit;
  ASSERT_TRUE(RoundCone(1.0, 0.2, 0.1).Intersect({{0, 0, 5}, {0, 0, -2}}, 1e9, &hit));
  EXPECT_NEAR(hit.s, (5 - 1.1) / 2, 1e-12);
}

std::vector<Vec3> Wave(int columns, int rows, double spacing) {
  std::vector<Vec3> nodes;
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= columns; ++i)
      nodes.push_back({i * spacing, j * spacing, 0.1 * std::sin(3.0 * i * spacing) * std::cos(2.0 * j * spacing)});
  return nodes;
}

// Straight down onto a height field every point is met, from either side, at the material coordinate above which the
// ray was sent; no ray slips between cells.
TEST(SheetGrid, HasNoCracks) {
  constexpr int kColumns = 13, kRows = 9;
  constexpr double kSpacing = 0.1;
  const SheetGrid sheet(kColumns, kRows, kSpacing, Wave(kColumns, kRows, kSpacing));
  for (int i = 0; i <= 4 * kColumns; ++i)
    for (int j = 0; j <= 4 * kRows; ++j)
      for (const double side : {-1.0, 1.0}) {
        const double x = 0.25 * i * kSpacing, y = 0.25 * j * kSpacing;  // nodes, edges, diagonals and insides
        ShapeHit hit;
        ASSERT_TRUE(sheet.Intersect({{x, y, 3 * side}, {0, 0, -side}}, 1e9, &hit)) << x << " " << y;
        EXPECT_NEAR(hit.material.x(), x, 1e-9);
        EXPECT_NEAR(hit.material.y(), y, 1e-9);
        EXPECT_NEAR(sheet.Locate(hit.material).z(), 3 * side - side * hit.s, 1e-9);
      }
  ShapeHit hit;
  EXPECT_FALSE(sheet.Intersect({{kColumns * kSpacing + 0.01, 0.3, 3}, {0, 0, -1}}, 1e9, &hit));
}

// Of several folds the nearest is met.
TEST(SheetGrid, MeetsTheNearestFold) {
  constexpr int kColumns = 40;
  constexpr double kSpacing = 0.05;
  std::vector<Vec3> nodes;
  for (int j = 0; j <= 4; ++j)
    for (int i = 0; i <= kColumns; ++i) nodes.push_back({0.3 * std::sin(0.5 * i), j * kSpacing, i * kSpacing});
  const SheetGrid folded(kColumns, 4, kSpacing, std::move(nodes));
  for (const double x : {-0.25, -0.1, 0.07, 0.2}) {
    ShapeHit from_below, from_above;
    ASSERT_TRUE(folded.Intersect({{x, 0.1, -1}, {0, 0, 1}}, 1e9, &from_below));
    ASSERT_TRUE(folded.Intersect({{x, 0.1, 4}, {0, 0, -1}}, 1e9, &from_above));
    EXPECT_LT(from_below.material.x(), 10 * kSpacing);
    EXPECT_GT(from_above.material.x(), 30 * kSpacing);
  }
}

}  // namespace
}  // namespace depthtween
