#include "core/fill/noise_samples.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace depthtween {
namespace {

constexpr float kMostNoise = 0.05F;  // as a share of depth: what differs by more is an edge
constexpr int kStillColor = 15;      // sum over channels, with room for the colour camera's own noise
constexpr size_t kFewestSamples = 500;

}  // namespace

void NoiseSamples::Add(float depth_m, float residual_m) {
  const int bin = static_cast<int>(depth_m / kBinWidth);
  if (bin < kBins && residual_m < kMostNoise * depth_m) residuals_[bin].push_back(residual_m);
}

void NoiseSamples::AddOverSpace(ImageView<const float> depth_m) {
  for (int y = 0; y < depth_m.height(); y += 2)
    for (int x = 1; x + 1 < depth_m.width(); x += 2) {
      const float a = depth_m(x - 1, y), b = depth_m(x, y), c = depth_m(x + 1, y);
      if (a > 0 && b > 0 && c > 0) Add(b, std::abs(a - 2 * b + c) / 2.449F);
    }
}

void NoiseSamples::AddOverTime(const RgbdView& before, const RgbdView& after) {
  const auto still = [&](int x, int y) {
    const Rgb8 a = before.color(x, y), b = after.color(x, y);
    return std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b) <= kStillColor;
  };
  for (int y = 1; y + 1 < before.depth_m.height(); y += 2)
    for (int x = 1; x + 1 < before.depth_m.width(); x += 2) {
      const float a = before.depth_m(x, y), b = after.depth_m(x, y);
      if (a <= 0 || b <= 0) continue;
      if (!still(x, y) || !still(x - 1, y) || !still(x + 1, y) || !still(x, y - 1) || !still(x, y + 1)) continue;
      Add(b, std::abs(a - b) / 1.414F);
    }
}

// Least squares of sigma = a + b z^2 over bins, weighted by their count, a and b not negative.
DepthNoise NoiseSamples::Fit(double depth_step_m) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (int i = 0; i < kBins; ++i) {
    std::vector<float>& r = residuals_[i];
    if (r.size() < kFewestSamples) continue;
    const auto middle = r.begin() + static_cast<ptrdiff_t>(r.size() / 2);
    std::nth_element(r.begin(), middle, r.end());
    const double z = (i + 0.5) * kBinWidth;
    const double sigma = 1.4826 * *middle, w = std::sqrt(static_cast<double>(r.size())), x = z * z;
    n += w, sx += w * x, sy += w * sigma, sxx += w * x * x, sxy += w * x * sigma;
  }
  if (n == 0) return {.a_m = 0.0015F, .b_per_m = 0.0004F};
  const double determinant = n * sxx - sx * sx;
  double b = determinant > 1e-9 * n * n ? (n * sxy - sx * sy) / determinant : 0.0;
  double a = (sy - b * sx) / n;
  if (b < 0) b = 0, a = sy / n;
  if (a < 0) a = 0, b = sxx > 0 ? sxy / sxx : 0.0;
  // Quantisation is noise too: a step of q has a standard deviation of q / sqrt(12).
  return {.a_m = static_cast<float>(std::max(a, depth_step_m / 3.46)), .b_per_m = static_cast<float>(b)};
}

}  // namespace depthtween
