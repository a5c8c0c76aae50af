#include <algorithm>
#include <cmath>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/upsample/keys.h"
#include "core/upsample/upsampler.h"

namespace depthtween {
namespace {

constexpr int kSampledKeys = 16;
// Depths outside are hardly those of a room, a stage or a street: most likely depth_scale is wrong.
constexpr double kPlausibleMedianNear = 0.1, kPlausibleMedianFar = 30.0;

// The noise of one pixel from the second difference of its row, (z[-1] - 2 z[0] + z[1]) / sqrt(6): blind to planes.
// Robust: edges and curvature are the tail that the median ignores.
struct NoiseSamples {
  static constexpr int kBins = 24;
  static constexpr double kBinWidth = 0.35;  // metres
  std::vector<float> residuals[kBins];
};

void CollectNoise(ImageView<const float> depth, NoiseSamples& samples) {
  for (int y = 0; y < depth.height(); y += 2)
    for (int x = 1; x + 1 < depth.width(); x += 2) {
      const float a = depth(x - 1, y), b = depth(x, y), c = depth(x + 1, y);
      if (a <= 0 || b <= 0 || c <= 0) continue;
      const int bin = static_cast<int>(b / NoiseSamples::kBinWidth);
      if (bin >= NoiseSamples::kBins) continue;
      const float residual = std::abs(a - 2 * b + c) / 2.449F;
      if (residual < 0.05F * b) samples.residuals[bin].push_back(residual);
    }
}

// The same from one pixel's change between two keys that nothing moved between: what differs from frame to frame is
// noise, what stays is the sensor's fixed pattern, which smoothing would only falsify.
void CollectNoiseOverTime(ImageView<const float> before, ImageView<const float> after,
                          ImageView<const Rgb8> color_before, ImageView<const Rgb8> color_after,
                          NoiseSamples& samples) {
  constexpr int kStillColor = 15;  // sum over channels, with room for the colour camera's own noise
  const auto still = [&](int x, int y) {
    const Rgb8 a = color_before(x, y), b = color_after(x, y);
    return std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b) <= kStillColor;
  };
  for (int y = 1; y + 1 < before.height(); y += 2)
    for (int x = 1; x + 1 < before.width(); x += 2) {
      const float a = before(x, y), b = after(x, y);
      const int bin = static_cast<int>(b / NoiseSamples::kBinWidth);
      if (a <= 0 || b <= 0 || bin >= NoiseSamples::kBins) continue;
      if (!still(x, y) || !still(x - 1, y) || !still(x + 1, y) || !still(x, y - 1) || !still(x, y + 1)) continue;
      const float residual = std::abs(a - b) / 1.414F;
      if (residual < 0.05F * b) samples.residuals[bin].push_back(residual);
    }
}

// Least squares of sigma = a + b z^2 over bins, weighted by their count, a and b not negative.
DepthNoise FitNoise(NoiseSamples& samples, double depth_step_m) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (int i = 0; i < NoiseSamples::kBins; ++i) {
    auto& r = samples.residuals[i];
    if (r.size() < 500) continue;
    const auto middle = r.begin() + static_cast<ptrdiff_t>(r.size() / 2);
    std::nth_element(r.begin(), middle, r.end());
    const double z = (i + 0.5) * NoiseSamples::kBinWidth;
    const double sigma = 1.4826 * *middle, w = std::sqrt(static_cast<double>(r.size())), x = z * z;
    n += w, sx += w * x, sy += w * sigma, sxx += w * x * x, sxy += w * x * sigma;
  }
  if (n == 0) return {.a_m = 0.0015F, .b_per_m = 0.0004F};  // too little depth to say: a Kinect v2's
  const double determinant = n * sxx - sx * sx;
  double b = determinant > 1e-9 * n * n ? (n * sxy - sx * sy) / determinant : 0.0;
  double a = (sy - b * sx) / n;
  if (b < 0) b = 0, a = sy / n;
  if (a < 0) a = 0, b = sxx > 0 ? sxy / sxx : 0.0;
  // Quantisation is noise too: a step of q has a standard deviation of q / sqrt(12).
  return {.a_m = static_cast<float>(std::max(a, depth_step_m / 3.46)), .b_per_m = static_cast<float>(b)};
}

}  // namespace

absl::StatusOr<ClipConstants> EstimateClipConstants(const FrameSource& source, bool noise_of_first_key) {
  const Sequence& sequence = source.sequence();
  const int keys = static_cast<int>(sequence.depth.size());
  const int sampled = std::min(keys, kSampledKeys);
  NoiseSamples noise, noise_over_time;
  std::vector<float> depths;
  for (int i = 0; i < sampled; ++i) {
    const int key = sampled == 1 ? 0 : static_cast<int>(static_cast<int64_t>(i) * (keys - 1) / (sampled - 1));
    ASSIGN_OR_RETURN(const Image<float> depth, source.Depth(key));
    if (i == 0 || !noise_of_first_key) CollectNoise(depth, noise);
    if (key + 1 < keys && !noise_of_first_key) {
      ASSIGN_OR_RETURN(const Image<float> next, source.Depth(key + 1));
      ASSIGN_OR_RETURN(const Image<Rgb8> color, source.Color(LocateKey(sequence, key).color_index));
      ASSIGN_OR_RETURN(const Image<Rgb8> next_color, source.Color(LocateKey(sequence, key + 1).color_index));
      CollectNoiseOverTime(depth, next, color, next_color, noise_over_time);
    }
    for (int y = 0; y < depth.height(); y += 2)
      for (int x = 0; x < depth.width(); x += 2)
        if (depth(x, y) > 0) depths.push_back(depth(x, y));
  }
  ClipConstants constants;
  if (depths.empty()) {
    constants.warnings.push_back("no depth frame holds a single measurement: every output will be unknown");
    return constants;
  }
  const auto percentile = [&](double p) {
    const auto at = depths.begin() + static_cast<ptrdiff_t>(p * static_cast<double>(depths.size() - 1));
    std::nth_element(depths.begin(), at, depths.end());
    return static_cast<double>(*at);
  };
  constants.median_depth_m = percentile(0.5);
  // The noise over time is the noise; where too little stood still to tell, what moved makes it too large, and the
  // noise over space, which holds the fixed pattern too, is nearer the truth.
  const DepthNoise over_space = FitNoise(noise, 1.0 / sequence.depth_scale);
  const DepthNoise over_time = FitNoise(noise_over_time, 1.0 / sequence.depth_scale);
  const float middle = static_cast<float>(constants.median_depth_m);
  const bool time_tells = !noise_of_first_key && over_time.At(middle) < over_space.At(middle);
  const DepthNoise fitted = time_tells ? over_time : over_space;
  constants.noise_a_m = fitted.a_m;
  constants.noise_b_per_m = fitted.b_per_m;
  constants.preview_near_m = (1 - kPreviewMargin) * percentile(0.01);
  constants.preview_far_m = (1 + kPreviewMargin) * percentile(0.99);
  if (constants.median_depth_m < kPlausibleMedianNear || constants.median_depth_m > kPlausibleMedianFar)
    constants.warnings.push_back(
        absl::StrFormat("camera.depth_scale = %g implies a median depth of %g m, which is hardly what was filmed: "
                        "check the units per metre",
                        sequence.depth_scale, constants.median_depth_m));
  return constants;
}

}  // namespace depthtween
