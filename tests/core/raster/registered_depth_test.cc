// Small depth maps whose moved form is known by hand.
#include "core/raster/registered_depth.h"

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// Whole pixels: the same values elsewhere, and what comes from beyond the image is unknown.
TEST(RegisterDepth, ShiftsByWholePixels) {
  Image<float> depth(12, 9);
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 12; ++x) depth(x, y) = 2.0F + 0.01F * static_cast<float>(x);
  const Image<float> moved = RegisterDepth(depth, {.right_px = 3, .down_px = -2});
  for (int y = 0; y < 7; ++y)
    for (int x = 0; x < 12; ++x) {
      if (x < 3)
        EXPECT_EQ(moved(x, y), 0);
      else
        EXPECT_NEAR(moved(x, y), depth(x - 3, y + 2), 1e-5);
    }
  EXPECT_EQ(moved(6, 7), 0);
}

// A card 4 px wide before a wall, and a parallax of 4 px between them: the card covers the wall, and what it leaves is
// unknown.
TEST(RegisterDepth, NearSurfacesCoverAndUncover) {
  Image<float> depth(32, 8, 2.0F);
  for (int y = 0; y < 8; ++y)
    for (int x = 10; x < 14; ++x) depth(x, y) = 1.0F;
  const Image<float> moved = RegisterDepth(depth, {.parallax_x_px_m = 8, .reference_m = 2});
  for (int x = 14; x < 18; ++x) EXPECT_NEAR(moved(x, 4), 1, 1e-5) << x;
  for (int x = 10; x < 14; ++x) EXPECT_EQ(moved(x, 4), 0) << x;
  EXPECT_NEAR(moved(8, 4), 2, 1e-5);
  EXPECT_NEAR(moved(20, 4), 2, 1e-5);
}

// Growth leaves no cracks in a surface.
TEST(RegisterDepth, GrowsWithoutCracks) {
  const Image<float> depth(40, 30, 1.5F);
  const Image<float> grown = RegisterDepth(depth, {.scale = 1.12});
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) EXPECT_NEAR(grown(x, y), 1.5F, 1e-5) << x << ", " << y;
}

}  // namespace
}  // namespace depthtween
