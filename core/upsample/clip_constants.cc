#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/fill/mixed_rim.h"
#include "core/fill/noise_samples.h"
#include "core/sequence/depth_scale.h"
#include "core/upsample/keys.h"
#include "core/upsample/upsampler.h"

namespace depthtween {
namespace {

constexpr int kSampledKeys = 16;

}  // namespace

absl::StatusOr<ClipConstants> EstimateClipConstants(const FrameSource& source, bool noise_of_first_key) {
  const Sequence& sequence = source.sequence();
  const int keys = static_cast<int>(sequence.depth.size());
  const int sampled = std::min(keys, kSampledKeys);
  NoiseSamples noise, noise_over_time;
  std::vector<float> depths;
  int64_t mixed = 0, known = 0;
  for (int i = 0; i < sampled; ++i) {
    const int key = sampled == 1 ? 0 : static_cast<int>(static_cast<int64_t>(i) * (keys - 1) / (sampled - 1));
    ASSIGN_OR_RETURN(Image<float> depth, source.Depth(key));
    mixed += DropMixedRim(depth);
    for (size_t p = 0; p < depth.pixel_count(); ++p) known += depth.data()[p] > 0 ? 1 : 0;
    if (i == 0 || !noise_of_first_key) noise.AddOverSpace(depth);
    if (key + 1 < keys && !noise_of_first_key) {
      ASSIGN_OR_RETURN(const Image<float> next, ReadDepthFrame(source, key + 1));
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
  if (auto warning = ImplausibleDepthScale(constants.median_depth_m, sequence.depth_scale))
    constants.warnings.push_back(*std::move(warning));
  if (mixed > 0)
    constants.warnings.push_back(absl::StrFormat(
        "%.1f %% of the measurements, all beside unknown pixels, are far nearer than their surface and are taken for "
        "unknown: the depth maps were resampled with unknown (0) taken for a depth; resample them by nearest neighbour",
        100.0 * static_cast<double>(mixed) / static_cast<double>(mixed + known)));
  return constants;
}

}  // namespace depthtween
