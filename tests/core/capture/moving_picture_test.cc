// Pictures are drawn for the test; values and motions follow from how.
#include "core/capture/moving_picture.h"

#include <cmath>

#include "gtest/gtest.h"
#include "tests/core/capture/moving_discs.h"

namespace depthtween {
namespace {

// Frames at 0, 10 and 20 ms: the nearest by hand; a tie goes to the earlier, and beyond the ends to the ends.
TEST(NearestColor, IsTheNearest) {
  Sequence sequence;
  for (int i = 0; i < 3; ++i) sequence.color.push_back({i * 10'000'000, "c"});
  EXPECT_EQ(NearestColor(sequence, -5), 0);
  EXPECT_EQ(NearestColor(sequence, 5'000'000), 0);
  EXPECT_EQ(NearestColor(sequence, 5'000'001), 1);
  EXPECT_EQ(NearestColor(sequence, 10'000'000), 1);
  EXPECT_EQ(NearestColor(sequence, 99'000'000), 2);
}

// A step of 100 levels in every channel at x = 15.5. Smoothed by (1 2 1)/4 the pixels beside it are 25 and 75; linear
// between pixels, so 0.75 to either side of the step lie 6.25 below 75 + 12.5 = 18.75 and 81.25: a change of 62.5
// levels. Along the step nothing changes.
TEST(MovingPicture, ContrastIsThatAcross) {
  Image<Rgb8> color(32, 32);
  for (int y = 0; y < 32; ++y)
    for (int x = 16; x < 32; ++x) color(x, y) = {100, 100, 100};
  const auto picture = MovingPicture::Make(color, color, 1.0, {});
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_NEAR(picture->Contrast2(15.5F, 16, 1, 0), 3 * 62.5 * 62.5, 1);
  EXPECT_NEAR(picture->Contrast2(15.5F, 16, 0, 1), 0, 1e-3);
  EXPECT_EQ(picture->Contrast2(8, 16, 1, 0), 0);
  EXPECT_TRUE(picture->Contains(3, 28, 3));
  EXPECT_FALSE(picture->Contains(2.9F, 16, 3));
}

// Everything moves 2 px right from one frame to the next, 4 ms later: 0.5 px/ms, so an edge seen 3 ms before is 1.5 px
// farther.
TEST(MovingPicture, EdgesMoveWithTheNearerSurface) {
  const MovingDiscs still({.seconds = 0.1, .speed = 0});
  const Image<Rgb8> wide = *still.Color(0);
  Image<Rgb8> here(96, 80), there(96, 80);
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 96; ++x) here(x, y) = wide(x + 8, y + 8), there(x, y) = wide(x + 6, y + 8);
  const auto picture = MovingPicture::Make(here, there, 4.0, {.finest_scale = 0});
  ASSERT_TRUE(picture.ok()) << picture.status();
  const DepthEdge edge{.x = 40, .y = 40, .normal_x = 1};
  const MovingPicture::Moved moved = picture->Move(edge, 3.0);
  EXPECT_NEAR(moved.velocity_x, 0.5, 0.03);
  EXPECT_NEAR(moved.velocity_y, 0.0, 0.03);
  EXPECT_NEAR(moved.x, 41.5, 0.1);
  EXPECT_NEAR(moved.y, 40, 0.1);
}

// The last frame has no next one: its motion is that to the one before, turned round. Both ends give one velocity.
TEST(ColorReader, LooksBackFromTheLastFrame) {
  const MovingDiscs clip({.seconds = 0.1});
  ColorReader reader(clip);
  const int last = static_cast<int>(clip.sequence().color.size()) - 1;
  const DepthEdge edge{.x = 64, .y = 48, .normal_x = 1};
  const auto before = reader.Read(last - 1, {.finest_scale = 0}), end = reader.Read(last, {.finest_scale = 0});
  ASSERT_TRUE(before.ok() && end.ok());
  const auto a = before->Move(edge, 0), b = end->Move(edge, 0);
  EXPECT_NEAR(a.velocity_x, b.velocity_x, 0.05);
  EXPECT_NEAR(a.velocity_y, b.velocity_y, 0.05);
}

}  // namespace
}  // namespace depthtween
