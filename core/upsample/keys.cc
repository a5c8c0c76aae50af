#include "core/upsample/keys.h"

#include <cmath>

#include "core/fill/key_cleaning.h"
#include "core/fill/mixed_rim.h"

namespace depthtween {
namespace {

// Window of the plane fit, pixels: 7 x 7 divides the noise of a flat part by about six.
constexpr int kDenoiseRadius = 3;

}  // namespace

Key LocateKey(const Sequence& sequence, int depth_index) {
  Key key;
  key.time_ns = sequence.depth[depth_index].time_ns;
  key.color_index = NearestColorFrame(sequence, key.time_ns);
  const auto& color = sequence.color;
  const int64_t offset = key.time_ns - color[key.color_index].time_ns;
  const int neighbour = offset > 0 ? key.color_index + 1 : key.color_index - 1;
  if (offset == 0 || neighbour < 0 || neighbour >= static_cast<int>(color.size())) return key;
  key.fraction = static_cast<float>(static_cast<double>(offset) /
                                    static_cast<double>(color[neighbour].time_ns - color[key.color_index].time_ns));
  key.toward = neighbour;
  return key;
}

absl::StatusOr<Image<float>> ReadDepthFrame(const FrameSource& source, int depth_index) {
  ASSIGN_OR_RETURN(Image<float> depth_m, source.Depth(depth_index));
  DropMixedRim(depth_m);
  return depth_m;
}

Image<float> MoveDepthToColorFrame(ImageView<const float> depth_m, ImageView<const Flow2> flow_to_neighbour,
                                   float fraction) {
  Image<float> moved(depth_m.width(), depth_m.height());
  for (int y = 0; y < moved.height(); ++y)
    for (int x = 0; x < moved.width(); ++x) {
      const Flow2 f = flow_to_neighbour(x, y);
      const int sx = static_cast<int>(std::lround(static_cast<float>(x) + fraction * f.u));
      const int sy = static_cast<int>(std::lround(static_cast<float>(y) + fraction * f.v));
      if (depth_m.Contains(sx, sy)) moved(x, y) = depth_m(sx, sy);
    }
  return moved;
}

void PrepareKey(ImageView<const float> depth_m, ImageView<const Rgb8> color, const DepthNoise& noise, int threads,
                Key& key) {
  const Image<float> solid = RemoveFlyingPixels(depth_m, noise, threads);
  FilledDepth filled = FillAlongColor(solid, color);
  key.depth_m = DenoiseInLayers(filled.depth_m, filled.distance, color, noise, kDenoiseRadius, threads);
  key.distance = std::move(filled.distance);
  key.image = MatchImage(color);
}

void MarkMeasured(const Key& key, ImageView<const float> depth_frame_m, ImageView<Provenance> provenance) {
  if (key.toward >= 0) return;
  for (int y = 0; y < provenance.height(); ++y)
    for (int x = 0; x < provenance.width(); ++x)
      if (key.distance(x, y) == 0 && depth_frame_m(x, y) > 0) provenance(x, y) = Provenance::kMeasured;
}

}  // namespace depthtween
