#include "core/upsample/keys.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/sequence/clock.h"

namespace depthtween {
namespace {

// Under this share of a frame step a depth frame counts as taken with its colour frame: motion within it is far below a
// pixel.
constexpr double kCoincident = 0.02;
// So does one whose offset the jitter of the stamps explains: moving it by a stamp's error would only add that error.
constexpr double kJitterSigmas = 4.0;
// Window of the plane fit, pixels: 7 x 7 divides the noise of a flat part by about six.
constexpr int kDenoiseRadius = 3;

}  // namespace

Key LocateKey(const Sequence& sequence, int depth_index) {
  Key key;
  key.time_ns = sequence.depth[depth_index].time_ns;
  const auto& color = sequence.color;
  const auto later = std::lower_bound(color.begin(), color.end(), key.time_ns,
                                      [](const FrameRef& frame, int64_t time) { return frame.time_ns < time; });
  int nearest = static_cast<int>(later - color.begin());
  const int count = static_cast<int>(color.size());
  if (nearest == count ||
      (nearest > 0 && key.time_ns - color[nearest - 1].time_ns < color[nearest].time_ns - key.time_ns))
    --nearest;
  key.color_index = nearest;
  const int64_t offset = key.time_ns - color[nearest].time_ns;
  const int neighbour = offset > 0 ? nearest + 1 : nearest - 1;
  if (offset == 0 || neighbour < 0 || neighbour >= count) return key;
  const auto step = static_cast<double>(std::llabs(color[neighbour].time_ns - color[nearest].time_ns));
  const double jitter = std::hypot(static_cast<double>(StampJitterNs(sequence.color)),
                                   static_cast<double>(StampJitterNs(sequence.depth)));
  const auto distance = static_cast<double>(std::llabs(offset));
  if (distance > kCoincident * step && distance > kJitterSigmas * jitter) {
    key.fraction = static_cast<float>(distance / step);
    key.toward = neighbour;
  } else {
    key.time_ns = color[nearest].time_ns;
  }
  return key;
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

void MarkMeasured(const Key& key, ImageView<Provenance> provenance) {
  if (key.toward >= 0) return;
  for (int y = 0; y < provenance.height(); ++y)
    for (int x = 0; x < provenance.width(); ++x)
      if (key.distance(x, y) == 0) provenance(x, y) = Provenance::kMeasured;
}

}  // namespace depthtween
