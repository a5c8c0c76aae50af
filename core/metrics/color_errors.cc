#include "core/metrics/color_errors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace depthtween {
namespace {

constexpr int kRadius = 5;
constexpr double kSigma = 1.5;

// Gaussian means of `at(x, y)`, renormalised at the borders.
template <typename At>
Image<float> Blur(int width, int height, const At& at) {
  std::array<double, 2 * kRadius + 1> kernel;
  for (int k = -kRadius; k <= kRadius; ++k) kernel[k + kRadius] = std::exp(-0.5 * k * k / (kSigma * kSigma));
  const auto mean = [&](int centre, int size, const auto& value) {
    double sum = 0, weight = 0;
    for (int k = std::max(-kRadius, -centre); k <= std::min(kRadius, size - 1 - centre); ++k) {
      sum += kernel[k + kRadius] * value(centre + k);
      weight += kernel[k + kRadius];
    }
    return static_cast<float>(sum / weight);
  };
  Image<float> rows(width, height), out(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) rows(x, y) = mean(x, width, [&](int i) { return at(i, y); });
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) out(x, y) = mean(y, height, [&](int i) { return rows(x, i); });
  return out;
}

Image<float> Luma601(ImageView<const Rgb8> color) {
  Image<float> luma(color.width(), color.height());
  for (int y = 0; y < color.height(); ++y)
    for (int x = 0; x < color.width(); ++x) {
      const Rgb8 c = color(x, y);
      luma(x, y) = 0.299F * c.r + 0.587F * c.g + 0.114F * c.b;
    }
  return luma;
}

Image<float> SsimMap(ImageView<const Rgb8> image, ImageView<const Rgb8> truth) {
  constexpr double kC1 = (0.01 * 255) * (0.01 * 255), kC2 = (0.03 * 255) * (0.03 * 255);
  const int width = truth.width(), height = truth.height();
  const Image<float> a = Luma601(image), b = Luma601(truth);
  const Image<float> mean_a = Blur(width, height, [&](int x, int y) { return a(x, y); });
  const Image<float> mean_b = Blur(width, height, [&](int x, int y) { return b(x, y); });
  const Image<float> aa = Blur(width, height, [&](int x, int y) { return a(x, y) * a(x, y); });
  const Image<float> bb = Blur(width, height, [&](int x, int y) { return b(x, y) * b(x, y); });
  const Image<float> ab = Blur(width, height, [&](int x, int y) { return a(x, y) * b(x, y); });
  Image<float> out(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double ma = mean_a(x, y), mb = mean_b(x, y);
      const double variance_a = aa(x, y) - ma * ma, variance_b = bb(x, y) - mb * mb, covariance = ab(x, y) - ma * mb;
      out(x, y) = static_cast<float>((2 * ma * mb + kC1) * (2 * covariance + kC2) /
                                     ((ma * ma + mb * mb + kC1) * (variance_a + variance_b + kC2)));
    }
  return out;
}

}  // namespace

void ColorErrors::Add(ImageView<const Rgb8> image, ImageView<const Rgb8> truth, ImageView<const uint8_t> mask) {
  const Image<float> ssim = SsimMap(image, truth);
  for (int y = 0; y < truth.height(); ++y)
    for (int x = 0; x < truth.width(); ++x) {
      if (!mask.empty() && mask(x, y) == 0) continue;
      const Rgb8 a = image(x, y), b = truth(x, y);
      const int dr = a.r - b.r, dg = a.g - b.g, db = a.b - b.b;
      squared_error_sum_ += dr * dr + dg * dg + db * db;
      ssim_sum_ += ssim(x, y);
      ++pixels_;
    }
}

void ColorErrors::Add(const ColorErrors& other) {
  pixels_ += other.pixels_;
  squared_error_sum_ += other.squared_error_sum_;
  ssim_sum_ += other.ssim_sum_;
}

double ColorErrors::PsnrDb() const {
  if (squared_error_sum_ <= 0) return std::numeric_limits<double>::infinity();
  return 10 * std::log10(255.0 * 255.0 * 3 * static_cast<double>(pixels_) / squared_error_sum_);
}

}  // namespace depthtween
