// Regions of depth steps, bars and plain walls, counted by hand.
#include "core/metrics/regions.h"

#include <algorithm>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// Left of column `edge` 1 m, from there on 2 m.
Image<float> Step(int width, int height, int edge) {
  Image<float> depth_m(width, height, 2.0F);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < edge; ++x) depth_m(x, y) = 1.0F;
  return depth_m;
}

// A step between columns 9 and 10: the jump marks both, the silhouette the near one, the band reaches 4 px further.
TEST(Regions, StepEdgeHasKnownJumpSilhouetteAndBand) {
  const Image<float> depth_m = Step(20, 5, 10);
  const Image<uint8_t> jumps = DepthJumps(depth_m), silhouettes = Silhouettes(depth_m), band = EdgeBand(depth_m);
  for (int x = 0; x < 20; ++x) {
    EXPECT_EQ(jumps(x, 2), x == 9 || x == 10) << x;
    EXPECT_EQ(silhouettes(x, 2), x == 9) << x;
    EXPECT_EQ(band(x, 2), x >= 5 && x <= 14) << x;
  }
}

// Sensors often miss the pixel on an edge: the jump is then seen by that pixel alone, whose window reaches both sides.
TEST(Regions, JumpAcrossOneMissingPixelCounts) {
  Image<float> depth_m = Step(20, 5, 10);
  for (int y = 0; y < 5; ++y) depth_m(10, y) = 0.0F;
  const Image<uint8_t> jumps = DepthJumps(depth_m), silhouettes = Silhouettes(depth_m);
  for (int x = 0; x < 20; ++x) {
    EXPECT_EQ(jumps(x, 2), x == 10) << x;
    EXPECT_EQ(silhouettes(x, 2), 0) << x;
  }
}

// By definition a jump is more than 15 cm, and between two known depths.
TEST(Regions, SmallStepsAndHolesAreNoJumps) {
  Image<float> depth_m(8, 4, 1.0F);
  for (int y = 0; y < 4; ++y) {
    for (int x = 3; x < 5; ++x) depth_m(x, y) = 1.14F;
    for (int x = 5; x < 8; ++x) depth_m(x, y) = 0.0F;
  }
  const Image<uint8_t> band = EdgeBand(depth_m);
  EXPECT_EQ(std::count(band.data(), band.data() + band.pixel_count(), 1), 0);
}

// Left half one grey, right half stripes: a window of 9 pixels that reaches no stripe is flat, one full of stripes is
// not.
TEST(Regions, UntexturedIsWhereNothingVaries) {
  Image<Rgb8> color(40, 20, Rgb8{100, 100, 100});
  for (int y = 0; y < 20; ++y)
    for (int x = 20; x < 40; x += 2) color(x, y) = {140, 140, 140};
  const Image<uint8_t> flat = Untextured(color);
  for (int x = 0; x < 16; ++x) EXPECT_EQ(flat(x, 10), 1) << x;
  for (int x = 20; x < 40; ++x) EXPECT_EQ(flat(x, 10), 0) << x;
}

TEST(Regions, DilationStopsAtTheBorder) {
  Image<uint8_t> mask(7, 6);
  mask(0, 5) = 1;
  mask(4, 2) = 1;
  const Image<uint8_t> grown = DilateSquare(mask, 1), disc = DilateDisc(mask, 1);
  for (int y = 0; y < 6; ++y)
    for (int x = 0; x < 7; ++x)
      EXPECT_EQ(grown(x, y), (x >= 3 && x <= 5 && y >= 1 && y <= 3) || (x <= 1 && y >= 4)) << x << " " << y;
  // Of radius 1 a disc is a cross: 5 pixels inside the image, 3 in its corner.
  EXPECT_EQ(std::count(disc.data(), disc.data() + disc.pixel_count(), 1), 8);
  // Of radius 4 it holds the 49 integer points of a circle of that radius (Gauss's circle problem).
  Image<uint8_t> point(11, 11);
  point(5, 5) = 1;
  const Image<uint8_t> circle = DilateDisc(point, 4);
  EXPECT_EQ(std::count(circle.data(), circle.data() + circle.pixel_count(), 1), 49);
}

// A bar of columns 4..7 moves right by 0.6 px a frame over a still ground, so after 5 frames it covers columns 7..10
// and the ground at 4..6, which it hid, comes out. Slow motion must not be lost to rounding.
TEST(KeyVisibility, FindsWhatComesOutFromBehindAMovingBar) {
  const int width = 20, height = 6;
  KeyVisibility visibility;
  EXPECT_FALSE(visibility.Started());
  visibility.Restart(width, height);
  EXPECT_TRUE(visibility.Started());
  Image<uint8_t> valid(width, height, 1);
  const auto bar_left = [](int frame) { return 4.0F + 0.6F * static_cast<float>(frame); };
  const auto in_bar = [&](float x, int frame) { return x >= bar_left(frame) - 0.5F && x < bar_left(frame) + 3.5F; };
  for (int frame = 0; frame < 5; ++frame) {
    Image<Flow2> flow(width, height);
    Image<uint8_t> hidden(width, height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const auto column = static_cast<float>(x);
        if (in_bar(column, frame)) flow(x, y) = {0.6F, 0.0F};
        hidden(x, y) = !in_bar(column, frame) && in_bar(column, frame + 1);
      }
    }
    visibility.Advance({.flow_px = flow, .valid = valid, .hidden_in_next = hidden});
  }
  const Image<uint8_t> unseen = visibility.Unseen();
  for (int x = 0; x < width; ++x) EXPECT_EQ(unseen(x, 3), x >= 4 && x <= 6) << x;
}

// A surface that grows by a quarter leaves single columns without a point, but all of it was seen.
TEST(KeyVisibility, GrowthIsNotDisocclusion) {
  const int width = 40, height = 8;
  KeyVisibility visibility;
  visibility.Restart(width, height);
  Image<Flow2> flow(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) flow(x, y) = {0.25F * static_cast<float>(x), 0.0F};
  const Image<uint8_t> valid(width, height, 1), hidden(width, height);
  visibility.Advance({.flow_px = flow, .valid = valid, .hidden_in_next = hidden});
  const Image<uint8_t> unseen = visibility.Unseen();
  EXPECT_EQ(std::count(unseen.data(), unseen.data() + unseen.pixel_count(), 1), 0);
}

}  // namespace
}  // namespace depthtween
