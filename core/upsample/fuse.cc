#include "core/upsample/fuse.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

constexpr float kAgree = 0.05F;        // share of depth: one surface, seen twice
constexpr float kEqualCost = 2.0F;     // sRGB units
constexpr float kTimeCost = 1.0F;      // what the far end of the interval costs the far key, sRGB units
constexpr float kSeenDistance = 1.5F;  // a key pixel nearer than this to a measurement counts as seen

// Far from everything where there is no key.
float DistanceAt(const Key* key, int x, int y, Flow2 m) {
  constexpr float kFar = 1e9F;
  if (key == nullptr) return kFar;
  const int nx = static_cast<int>(std::floor(static_cast<float>(x) + m.u + 0.5F));
  const int ny = static_cast<int>(std::floor(static_cast<float>(y) + m.v + 0.5F));
  return key->distance.Contains(nx, ny) ? key->distance(nx, ny) : kFar;
}

}  // namespace

Fused Fuse(const ChooseInput& input, const Choice& choice, int threads) {
  const int width = choice.uncertain.width(), height = choice.uncertain.height();
  const float tau = std::clamp(input.tau, 0.0F, 1.0F);
  Fused out{Image<float>(width, height), Image<float>(width, height), Image<float>(width, height),
            Image<Provenance>(width, height), Image<uint8_t>(width, height)};
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const float z0 = choice.sides[0].depth_m(x, y), z1 = choice.sides[1].depth_m(x, y);
        const float c0 = choice.sides[0].cost(x, y) + kTimeCost * tau,
                    c1 = choice.sides[1].cost(x, y) + kTimeCost * (1 - tau);
        if (z0 <= 0 && z1 <= 0) continue;
        const float distance0 = DistanceAt(input.keys[0], x, y, choice.sides[0].motion(x, y));
        const float distance1 = DistanceAt(input.keys[1], x, y, choice.sides[1].motion(x, y));
        const bool seen0 = distance0 < kSeenDistance, seen1 = distance1 < kSeenDistance;
        const float nearer = std::min(z0, z1), gap = std::abs(z0 - z1);
        if (nearer > 0) out.change_m(x, y) = z1 - z0;
        const bool first = z1 <= 0 || (z0 > 0 && c0 <= c1);
        const float fit0 = std::exp(-c0 / kCostScale), fit1 = std::exp(-c1 / kCostScale);
        if (nearer > 0 && gap <= kAgree * nearer) {
          const float w0 = (1 - tau + 0.01F) * fit0, w1 = (tau + 0.01F) * fit1;
          out.confirmed(x, y) = distance0 == 0 && distance1 == 0;
          out.depth_m(x, y) = w0 + w1 > 0 ? (w0 * z0 + w1 * z1) / (w0 + w1) : (1 - tau) * z0 + tau * z1;
          out.provenance(x, y) = seen0 && seen1   ? Provenance::kBoth
                                 : seen0 || seen1 ? Provenance::kOne
                                                  : Provenance::kInferred;
        } else if (nearer > 0 && gap <= kOneSurface * nearer && std::abs(c0 - c1) <= kEqualCost) {
          out.depth_m(x, y) = (1 - tau) * z0 + tau * z1;
          out.provenance(x, y) = seen0 && seen1   ? Provenance::kBoth
                                 : seen0 || seen1 ? Provenance::kOne
                                                  : Provenance::kInferred;
        } else {
          out.depth_m(x, y) = first ? z0 : z1;
          out.provenance(x, y) = (first ? seen0 : seen1) ? Provenance::kOne : Provenance::kInferred;
        }
        out.confidence(x, y) = (first ? fit0 : fit1) + 1e-3F;
      }
  });
  return out;
}

Image<float> MedianNearJumps(const Fused& fused, ImageView<const Rgb8> color,
                             const std::vector<MedianWitness>& witnesses, int radius, const DepthNoise& noise,
                             int threads) {
  if (radius == 0) return fused.depth_m.Clone();
  Image<uint8_t> mask = NearDepthJumps(fused.depth_m, radius + 1, noise, threads);
  for (size_t p = 0; p < mask.pixel_count(); ++p)
    if (fused.confirmed.data()[p]) mask.data()[p] = 0;
  return WeightedMedian({fused.depth_m, fused.confidence, color}, witnesses, mask, {.radius = radius}, threads);
}

}  // namespace depthtween
