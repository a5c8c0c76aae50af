// Shapes of apertures against their areas in closed form.
#include "core/render/aperture.h"

#include <cmath>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr double kPi = 3.14159265358979323846;

// The share of a pixel that the shape covers.
double Coverage(const Aperture& aperture, float radius, int x, int y) {
  const Aperture::Shape& shape = aperture.Scaled(radius);
  if (std::abs(y) > shape.reach) return 0;
  double sum = 0;
  for (const auto& [px, change] : aperture.RowAt(shape.first_row + y))
    if (px <= x) sum += change;
  return sum;
}

class ShapeOfBlades : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Blades, ShapeOfBlades, testing::Values(0, 3, 4, 5, 6, 9));

// All shapes have the area of the disc, spread over pixels without loss and centred on the point.
TEST_P(ShapeOfBlades, HasTheAreaOfTheDisc) {
  const Aperture aperture(GetParam(), 20.0F);
  for (const float radius : {1.5F, 4.25F, 7.0F, 19.625F, -6.5F}) {
    double area = 0, moment_x = 0, moment_y = 0;
    for (int y = -40; y <= 40; ++y)
      for (int x = -40; x <= 40; ++x) {
        const double share = Coverage(aperture, radius, x, y);
        area += share;
        moment_x += share * x;
        moment_y += share * y;
      }
    EXPECT_NEAR(area, aperture.Scaled(radius).area, 1e-4 * area);
    EXPECT_NEAR(area, kPi * radius * radius, 0.02 * area) << radius;
    EXPECT_NEAR(moment_x / area, 0, 1e-4);
    EXPECT_NEAR(moment_y / area, 0, 0.06);
  }
}

TEST_P(ShapeOfBlades, IsUpsideDownInFrontOfTheFocus) {
  const Aperture aperture(GetParam(), 20.0F);
  for (int y = -20; y <= 20; ++y)
    for (int x = -20; x <= 20; ++x)
      EXPECT_NEAR(Coverage(aperture, 9.5F, x, y), Coverage(aperture, -9.5F, -x, -y), 1e-4);
}

// A triangle's tip is up: above its centre it reaches farther than below.
TEST(Aperture, HasATipOnTop) {
  const Aperture aperture(3, 20.0F);
  EXPECT_GT(Coverage(aperture, 10.0F, 0, -12), 0.5);
  EXPECT_EQ(Coverage(aperture, 10.0F, 0, 12), 0.0);
}

TEST(Aperture, KeepsSmallCirclesInTheirPixel) {
  const Aperture aperture(0, 2.0F);
  for (const float radius : {0.0F, 0.25F, -0.5F}) {
    EXPECT_EQ(aperture.Scaled(radius).reach, 0);
    EXPECT_NEAR(Coverage(aperture, radius, 0, 0) / aperture.Scaled(radius).area, 1, 1e-5);
  }
}

// The inner part of a disc covers pixels fully, its rim in part, beyond it nothing: known from the distance.
TEST(Aperture, IsARoundDisc) {
  const Aperture aperture(0, 20.0F);
  for (const float radius : {3.0F, 8.375F, 20.0F})
    for (int y = -24; y <= 24; ++y)
      for (int x = -24; x <= 24; ++x) {
        const double distance = std::hypot(x, y);
        const double share = Coverage(aperture, radius, x, y);
        EXPECT_TRUE(distance > radius - 0.8 || share > 1 - 1e-5) << x << " " << y;
        EXPECT_TRUE(distance < radius + 0.8 || share < 1e-5) << x << " " << y;
      }
}

}  // namespace
}  // namespace depthtween
