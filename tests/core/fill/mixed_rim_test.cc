// Depth maps with holes that this file makes, whole and shrunk by averages in which unknown counts as zero.
#include "core/fill/mixed_rim.h"

#include <gtest/gtest.h>

#include <cstdlib>

namespace depthtween {
namespace {

constexpr int kWidth = 120, kHeight = 90;

// A card (1 m) before a wall that slants from 2 to 3 m, in a frame without measurements and with a shadow of the card.
Image<float> Scene(int width, int height) {
  Image<float> depth(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double u = static_cast<double>(x) / width, v = static_cast<double>(y) / height;
      const bool frame = u < 0.05 || u > 0.95 || v < 0.06 || v > 0.94;
      const bool card = u > 0.4 && u < 0.6 && v > 0.3 && v < 0.7;
      const bool shadow = u > 0.34 && u <= 0.4 && v > 0.3 && v < 0.7;
      depth(x, y) = frame || shadow ? 0.0F : card ? 1.0F : static_cast<float>(2 + u);
    }
  return depth;
}

// Of a map of `factor` times the size.
Image<float> Averaged(int factor) {
  const Image<float> large = Scene(factor * kWidth, factor * kHeight);
  Image<float> small(kWidth, kHeight);
  for (int y = 0; y < large.height(); ++y)
    for (int x = 0; x < large.width(); ++x)
      small(x / factor, y / factor) += large(x, y) / static_cast<float>(factor * factor);
  return small;
}

int Different(const Image<float>& a, const Image<float>& b) {
  int count = 0;
  for (size_t p = 0; p < a.pixel_count(); ++p) count += a.data()[p] != b.data()[p] ? 1 : 0;
  return count;
}

TEST(DropMixedRim, KeepsWhatASensorReturns) {
  Image<float> depth = Scene(kWidth, kHeight);
  EXPECT_EQ(DropMixedRim(depth), 0);
  EXPECT_EQ(Different(depth, Scene(kWidth, kHeight)), 0);
}

// Mixtures of zero and 2 m are far nearer than 2 m. Those of card and wall are between, and not of this kind.
TEST(DropMixedRim, DropsMixturesWithUnknown) {
  for (const int factor : {3, 7}) {
    Image<float> depth = Averaged(factor);
    EXPECT_GT(DropMixedRim(depth), 100);
    const Image<float> truth = Scene(kWidth, kHeight);
    int wrong = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) wrong += depth(x, y) > 0 && depth(x, y) < 0.9F ? 1 : 0;
    EXPECT_LE(wrong, 4) << factor;  // at corners
    EXPECT_LT(Different(depth, Averaged(factor)), kWidth * kHeight / 10);
  }
}

TEST(DropMixedRim, LeavesFewPixelsAlone) {
  Image<float> depth(40, 30, 2.0F);
  depth(10, 10) = 0, depth(11, 10) = 0.5F;
  EXPECT_EQ(DropMixedRim(depth), 0);
  EXPECT_EQ(depth(11, 10), 0.5F);
  Image<float> nothing(40, 30);
  EXPECT_EQ(DropMixedRim(nothing), 0);
}

}  // namespace
}  // namespace depthtween
