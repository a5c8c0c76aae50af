#include "core/render/depth_of_field.h"

#include <algorithm>
#include <cassert>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/render/gather.h"
#include "core/render/kraus.h"
#include "core/render/lens_layers.h"
#include "core/render/linear_light.h"

namespace depthtween {

absl::Status DepthOfFieldOptions::Validate() const {
  if (blades != 0 && (blades < 3 || blades > 16))
    return absl::InvalidArgumentError(absl::StrFormat("blades = %d, must be 3 to 16, or 0 for a disc", blades));
  if (!(max_radius_px > 0 && max_radius_px <= 128))
    return absl::InvalidArgumentError(
        absl::StrFormat("max_radius_px = %g, must be above 0 and at most 128", max_radius_px));
  if (layers < 4 || layers > 64)
    return absl::InvalidArgumentError(absl::StrFormat("layers = %d, must be 4 to 64", layers));
  return absl::OkStatus();
}

Image<Rgb8> RenderDepthOfField(const RenderView& view, const HiddenBackground& hidden, const CircleOfConfusion& circle,
                               const DepthOfFieldOptions& options, int threads) {
  assert(options.Validate().ok() && view.color.SameSize(view.depth_m));
  CircleOfConfusion limited = circle;
  limited.limit_px = std::min(circle.limit_px, options.max_radius_px);
  const Image<Light> light = [&] {
    switch (options.method) {
      case DepthOfFieldMethod::kKraus:
        return BlurByPyramids(view, limited, threads);
      case DepthOfFieldMethod::kGather:
        return BlurByGathering(view, limited, threads);
      case DepthOfFieldMethod::kLayers:
        break;
    }
    return BlurInLayers(view, hidden, limited, {.blades = options.blades, .layers = options.layers}, threads);
  }();
  Image<Rgb8> out(light.width(), light.height());
  const LinearLight& tables = LinearLight::Tables();
  ParallelRows(out.height(), threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < out.width(); ++x) out(x, y) = tables.Encode(light(x, y));
  });
  return out;
}

}  // namespace depthtween
