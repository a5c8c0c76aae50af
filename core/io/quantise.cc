#include "core/io/quantise.h"

#include <algorithm>
#include <cmath>

namespace depthtween {
namespace {

template <typename In, typename Out, typename Convert>
Image<Out> Map(ImageView<const In> in, Convert convert) {
  Image<Out> out(in.width(), in.height());
  for (int y = 0; y < in.height(); ++y) std::transform(in.row(y), in.row(y) + in.width(), out.row(y), convert);
  return out;
}

}  // namespace

uint16_t DepthToUnits(float depth_m, double depth_scale) {
  if (!(depth_m > 0.0F)) return kUnknownDepthUnits;  // NaN too
  return static_cast<uint16_t>(std::min(std::floor(depth_m * depth_scale + 0.5), 65535.0));
}

uint16_t SigmaToUnits(float sigma_m, double depth_scale) {
  if (!(sigma_m > 0.0F)) return kUnknownSigmaUnits;
  return static_cast<uint16_t>(std::clamp(std::floor(sigma_m * depth_scale + 0.5), 1.0, 65534.0));
}

Image<uint16_t> QuantiseDepth(ImageView<const float> depth_m, double depth_scale) {
  return Map<float, uint16_t>(depth_m, [=](float d) { return DepthToUnits(d, depth_scale); });
}

Image<float> DequantiseDepth(ImageView<const uint16_t> units, double depth_scale) {
  return Map<uint16_t, float>(units, [=](uint16_t u) { return static_cast<float>(u / depth_scale); });
}

Image<float> DequantiseRecordedDepth(ImageView<const uint16_t> units, double depth_scale) {
  return Map<uint16_t, float>(
      units, [=](uint16_t u) { return u == kLargestDepthUnits ? 0.0F : static_cast<float>(u / depth_scale); });
}

Image<uint16_t> QuantiseSigma(ImageView<const float> sigma_m, double depth_scale) {
  return Map<float, uint16_t>(sigma_m, [=](float s) { return SigmaToUnits(s, depth_scale); });
}

Image<float> DequantiseSigma(ImageView<const uint16_t> units, double depth_scale) {
  return Map<uint16_t, float>(
      units, [=](uint16_t u) { return u == kUnknownSigmaUnits ? 0.0F : static_cast<float>(u / depth_scale); });
}

}  // namespace depthtween
