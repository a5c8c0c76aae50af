// Surfaces moved by known amounts: planes are affine in inverse depth, so they are drawn exactly.
#include "core/raster/surface_raster.h"

#include "gtest/gtest.h"

namespace depthtween {
namespace {

Image<Flow2> Standing(int width, int height, float dx = 0, float dy = 0) {
  Image<Flow2> positions(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) positions(x, y) = {static_cast<float>(x) + dx, static_cast<float>(y) + dy};
  return positions;
}

// Points that stay where they are draw the map they came from.
TEST(DrawSurface, StandingStillIsTheIdentity) {
  Image<float> depth(16, 12);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 16; ++x) depth(x, y) = 1.0F / (0.5F + 0.002F * static_cast<float>(x));
  const DrawnSurface drawn = DrawSurface(Standing(16, 12), depth, 16, 12, {});
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 16; ++x) {
      EXPECT_NEAR(drawn.depth_m(x, y), depth(x, y), 1e-5F);
      EXPECT_NEAR(drawn.source(x, y).u, x, 1e-3F);
      EXPECT_NEAR(drawn.source(x, y).v, y, 1e-3F);
    }
}

// A plane moved by 2.5 px: its inverse depth is affine in the image, so half-way values are exact; what it left is
// empty.
TEST(DrawSurface, MovesByFractionsOfAPixel) {
  Image<float> depth(16, 8);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 16; ++x) depth(x, y) = 1.0F / (0.5F + 0.01F * static_cast<float>(x));
  const DrawnSurface drawn = DrawSurface(Standing(16, 8, 2.5F), depth, 16, 8, {});
  EXPECT_EQ(drawn.depth_m(2, 4), 0.0F);
  EXPECT_NEAR(1.0F / drawn.depth_m(8, 4), 0.5F + 0.01F * 5.5F, 1e-5F);
  EXPECT_NEAR(drawn.source(8, 4).u, 5.5F, 1e-4F);
}

// With a vertex at every second pixel a plane is the same plane.
TEST(DrawSurface, NeedsFewVerticesForAPlane) {
  Image<Flow2> positions(8, 4);
  Image<float> depth(8, 4);
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 8; ++i) {
      positions(i, j) = {2.0F * static_cast<float>(i) + 1, 2.0F * static_cast<float>(j)};
      depth(i, j) = 1.0F / (0.5F + 0.01F * static_cast<float>(2 * i));
    }
  const DrawnSurface drawn = DrawSurface(positions, depth, 16, 8, {.step = 2});
  EXPECT_NEAR(1.0F / drawn.depth_m(6, 3), 0.5F + 0.01F * 5, 1e-5F);
  EXPECT_NEAR(drawn.source(6, 3).u, 5, 1e-4F);
  EXPECT_NEAR(drawn.source(6, 3).v, 3, 1e-4F);
}

// A near patch slides over a far wall: the near one is seen, and no triangle joins the two.
TEST(DrawSurface, NearestWinsAndCutsStayOpen) {
  Image<float> depth(20, 10, 4.0F);
  Image<Flow2> positions = Standing(20, 10);
  for (int y = 0; y < 10; ++y)
    for (int x = 5; x < 10; ++x) depth(x, y) = 1.0F, positions(x, y).u += 4;
  const DrawnSurface drawn = DrawSurface(positions, depth, 20, 10, {});
  for (int y = 0; y < 10; ++y) {
    for (int x = 9; x < 14; ++x) EXPECT_EQ(drawn.depth_m(x, y), 1.0F) << x;
    for (int x = 5; x < 9; ++x) EXPECT_EQ(drawn.depth_m(x, y), 0.0F) << x;  // disoccluded: nobody saw what is there
    for (int x = 14; x < 20; ++x) EXPECT_EQ(drawn.depth_m(x, y), 4.0F) << x;
  }
}

// A mirrored patch has all triangles turned over, a stretched one all edges too long: neither is drawn.
TEST(DrawSurface, DrawsNothingTurnedOverOrTorn) {
  const Image<float> depth(10, 10, 2.0F);
  Image<Flow2> mirrored(10, 10), stretched(10, 10);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 10; ++x) {
      mirrored(x, y) = {9.0F - static_cast<float>(x), static_cast<float>(y)};
      stretched(x, y) = {3.0F * static_cast<float>(x), 3.0F * static_cast<float>(y)};
    }
  for (const auto* positions : {&mirrored, &stretched}) {
    const DrawnSurface drawn = DrawSurface(*positions, depth, 10, 10, {});
    for (size_t i = 0; i < 100; ++i) EXPECT_EQ(drawn.depth_m.data()[i], 0.0F);
  }
}

}  // namespace
}  // namespace depthtween
