// Scores that can be worked out by hand.
#include "core/metrics/color_errors.h"

#include <cmath>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

Image<Rgb8> Ramp(int offset) {
  Image<Rgb8> image(24, 20);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 24; ++x) {
      const auto grey = static_cast<uint8_t>(5 * x + 3 * y + offset);
      image(x, y) = {grey, grey, grey};
    }
  return image;
}

TEST(ColorErrors, EqualImages) {
  ColorErrors errors;
  errors.Add(Ramp(0), Ramp(0), {});
  EXPECT_EQ(errors.pixels(), 480);
  EXPECT_TRUE(std::isinf(errors.PsnrDb()));
  EXPECT_NEAR(errors.Ssim(), 1.0, 1e-6);
}

// A constant difference of 10 everywhere: MSE 100.
TEST(ColorErrors, ConstantDifference) {
  ColorErrors errors;
  errors.Add(Ramp(10), Ramp(0), {});
  EXPECT_NEAR(errors.PsnrDb(), 10 * std::log10(255.0 * 255.0 / 100.0), 1e-9);
  EXPECT_LT(errors.Ssim(), 1.0);
  EXPECT_GT(errors.Ssim(), 0.9) << "structure is untouched";
}

// Two constant images: SSIM is its luminance term alone, (2ab + c1) / (a^2 + b^2 + c1).
TEST(ColorErrors, SsimOfConstants) {
  ColorErrors errors;
  errors.Add(Image<Rgb8>(16, 16, Rgb8{100, 100, 100}), Image<Rgb8>(16, 16, Rgb8{50, 50, 50}), {});
  const double c1 = 2.55 * 2.55;
  EXPECT_NEAR(errors.Ssim(), (2 * 100.0 * 50.0 + c1) / (100.0 * 100.0 + 50.0 * 50.0 + c1), 1e-4);
}

// Only the masked pixel counts, and pooling adds pixels, not scores.
TEST(ColorErrors, MaskAndPool) {
  Image<Rgb8> image = Ramp(0);
  image(3, 4).g = static_cast<uint8_t>(image(3, 4).g + 30);
  Image<uint8_t> mask(24, 20);
  mask(3, 4) = 1;
  ColorErrors one;
  one.Add(image, Ramp(0), mask);
  EXPECT_EQ(one.pixels(), 1);
  EXPECT_NEAR(one.PsnrDb(), 10 * std::log10(255.0 * 255.0 / 300.0), 1e-9);
  ColorErrors pooled;
  pooled.Add(Ramp(0), Ramp(0), {});
  pooled.Add(one);
  EXPECT_EQ(pooled.pixels(), 481);
  EXPECT_NEAR(pooled.PsnrDb(), 10 * std::log10(255.0 * 255.0 * 481 / 300.0), 1e-9);
}

}  // namespace
}  // namespace depthtween
