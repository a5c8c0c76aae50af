#include <algorithm>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/fill/noise_samples.h"
#include "core/upsample/keys.h"
#include "core/upsample/upsampler.h"

namespace depthtween {
namespace {

constexpr int kSampledKeys = 16;
// Depths outside are hardly those of a room, a stage or a street: most likely depth_scale is wrong.
constexpr double kPlausibleMedianNear = 0.1, kPlausibleMedianFar = 30.0;

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
    if (i == 0 || !noise_of_first_key) noise.AddOverSpace(depth);
    if (key + 1 < keys && !noise_of_first_key) {
      ASSIGN_OR_RETURN(const Image<float> next, source.Depth(key + 1));
      ASSIGN_OR_RETURN(const Image<Rgb8> color, source.Color(LocateKey(sequence, key).color_index));
      ASSIGN_OR_RETURN(const Image<Rgb8> next_color, source.Color(LocateKey(sequence, key + 1).color_index));
      noise_over_time.AddOverTime({color, depth}, {next_color, next});
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
  const DepthNoise over_space = noise.Fit(1.0 / sequence.depth_scale);
  const DepthNoise over_time = noise_over_time.Fit(1.0 / sequence.depth_scale);
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
