// Planes and steps whose depth and normals are known; inverse depth is linear on a plane, so it is found exactly.
#include "core/solve/surface.h"

#include <cmath>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr Camera kSurfaceCamera{.width = 32, .height = 24, .fx = 40, .fy = 40, .cx = 15.5, .cy = 11.5};

// z = 2 + 0.5 x (metres): along a ray x = z u, z = 2/(1 - u/2).
Image<float> Slant() {
  Image<float> depth(32, 24);
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 32; ++x) depth(x, y) = 2.0F / (1.0F - 0.5F * (static_cast<float>(x) - 15.5F) / 40.0F);
  return depth;
}

TEST(Surface, DepthAndNormalOfASlant) {
  const Image<float> depth = Slant();
  const IdealPixels pixels(kSurfaceCamera);
  EXPECT_NEAR(DepthBetweenPixels(depth, 10.3F, 7.6F, {}), 2.0 / (1 - 0.5 * (10.3 - 15.5) / 40), 1e-5);
  const Triple<float> normal = NormalAt(depth, pixels, 16, 12, 2, {});
  const double length = std::sqrt(1.25);
  EXPECT_NEAR(normal.x, 0.5 / length, 1e-4);
  EXPECT_NEAR(normal.y, 0, 1e-4);
  EXPECT_NEAR(normal.z, -1 / length, 1e-4);
}

TEST(Surface, NeverMixesLayers) {
  Image<float> depth(32, 24, 1.0F);
  for (int y = 0; y < 24; ++y)
    for (int x = 16; x < 32; ++x) depth(x, y) = 3.0F;
  EXPECT_EQ(DepthBetweenPixels(depth, 15.4F, 5, {}), 1.0F);
  EXPECT_EQ(DepthBetweenPixels(depth, 15.6F, 5, {}), 3.0F);
  EXPECT_NEAR(NormalAt(depth, IdealPixels(kSurfaceCamera), 15, 5, 2, {}).z, -1, 1e-5);
  EXPECT_EQ(DepthBetweenPixels(depth, -3, 5, {}), 0.0F);
}

}  // namespace
}  // namespace depthtween
