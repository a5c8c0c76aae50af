// The shapes are drawn for the test, so where their edges lie is known.
#include "core/capture/depth_edges.h"

#include <cmath>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// A disc before a wall: every edge lies on the circle, its normal points outwards, and all of the circle is found.
TEST(DepthEdges, LieOnTheOutlineAndPointAway) {
  Image<float> depth(64, 64, 3.0F);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x)
      if (std::hypot(x - 30.0, y - 33.0) < 18) depth(x, y) = 1.5F;
  const auto edges = FindDepthEdges(depth);
  // One for each row and column where it is crossed: about 8 r / sqrt(2).
  EXPECT_GT(edges.size(), 90U);
  EXPECT_LT(edges.size(), 115U);
  double mean = 0;
  for (const DepthEdge& edge : edges) {
    const double dx = edge.x - 30, dy = edge.y - 33, distance = std::hypot(dx, dy);
    EXPECT_NEAR(distance, 18, 1.0);
    EXPECT_GT((edge.normal_x * dx + edge.normal_y * dy) / distance, 0.95);
    mean += distance / static_cast<double>(edges.size());
  }
  // The pixels whose centres are inside reach to a circle a little smaller: 0.13 px here.
  EXPECT_NEAR(mean, 18, 0.2) << "neither outside nor inside on the whole";
}

// One row: a jump over two missing pixels is in their middle, over three it is none; a slope is none.
TEST(DepthEdges, BridgeTwoMissingPixels) {
  for (const int missing : {0, 2, 3}) {
    Image<float> depth(40, 20, 1.0F);
    for (int y = 0; y < 20; ++y)
      for (int x = 20; x < 40; ++x) depth(x, y) = x < 20 + missing ? 0.0F : 2.0F;
    const auto edges = FindDepthEdges(depth);
    if (missing == 3) {
      EXPECT_TRUE(edges.empty());
      continue;
    }
    ASSERT_EQ(edges.size(), 20U) << missing;
    EXPECT_FLOAT_EQ(edges[10].x, 19.5F + 0.5F * static_cast<float>(missing));
    EXPECT_NEAR(edges[10].normal_x, 1, 1e-5);
  }
  Image<float> slope(40, 20);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 40; ++x) slope(x, y) = 1.0F + 0.03F * static_cast<float>(x);
  EXPECT_TRUE(FindDepthEdges(slope).empty());
}

// Inside a rod of two pixels, less than kInsideEdgePx, there is no place to look up its motion.
TEST(DepthEdges, LeaveOutWhatIsTooThin) {
  Image<float> depth(40, 20, 3.0F);
  for (int y = 0; y < 20; ++y)
    for (int x = 18; x < 20; ++x) depth(x, y) = 1.0F;
  EXPECT_TRUE(FindDepthEdges(depth).empty());
}

}  // namespace
}  // namespace depthtween
