#include "core/upsample/fuse.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

constexpr float kAgree = 0.05F;     // share of depth: one surface, seen twice
constexpr float kModerate = 0.20F;  // share of depth: one surface that moved in depth, if both match
constexpr float kEqualCost = 2.0F;  // sRGB units
constexpr float kCostScale = 4.0F;  // a match worse by this counts 1/e
constexpr float kTimeCost = 1.0F;   // what the far end of the interval costs the far key, sRGB units
constexpr int kJumpReach = 2;       // pixels from a silhouette where its wrong side is a danger
// Standard deviations. Fitted by coordinate search on five scenes of the library and on real/hands (1 in 8), so that in
// every bin of predictions RMSE equals the prediction (reliability), shares within k sigma are a Gaussian's, and the
// least sure pixels are the wrong ones (sparsification); then what grows with disagreement and mismatch was raised
// until real/table, whose sensor errs most, covered as much as before. Rendered scenes are overrated, by 15 to 50 %,
// and table underrated by half: its sensor misplaces edges, which nothing here can see.
constexpr float kNoiseLeft = 0.5F;    // of the noise of a measurement, after keys are denoised and two of them fused
constexpr float kSpreadOfOne = 0.5F;  // of what two answers about one surface differ by
constexpr float kSpreadOfTwo = 0.3F;  // of what answers about two surfaces differ by
constexpr float kWrongSidePerCost = 1.0F / 60.0F, kLeastWrongSide = 0.12F;  // of the step at a silhouette
constexpr float kDriftPerCost = 0.0005F;                                    // of depth
constexpr float kUnconfirmed = 0.005F;                                      // of depth, where only one key saw it
constexpr float kGuess = 0.12F;                                             // of depth, where neither key saw it
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
        if (nearer > 0) out.spread_m(x, y) = gap;
        const bool first = z1 <= 0 || (z0 > 0 && c0 <= c1);
        const float fit0 = std::exp(-c0 / kCostScale), fit1 = std::exp(-c1 / kCostScale);
        if (nearer > 0 && gap <= kAgree * nearer) {
          const float w0 = (1 - tau + 0.01F) * fit0, w1 = (tau + 0.01F) * fit1;
          out.confirmed(x, y) = distance0 == 0 && distance1 == 0;
          out.depth_m(x, y) = w0 + w1 > 0 ? (w0 * z0 + w1 * z1) / (w0 + w1) : (1 - tau) * z0 + tau * z1;
          out.provenance(x, y) = seen0 && seen1   ? Provenance::kBoth
                                 : seen0 || seen1 ? Provenance::kOne
                                                  : Provenance::kInferred;
        } else if (nearer > 0 && gap <= kModerate * nearer && std::abs(c0 - c1) <= kEqualCost) {
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

Image<float> PredictSigma(ImageView<const float> depth_m, const Fused& fused, const DepthNoise& noise, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  Image<float> sigma(width, height);
  const Image<uint8_t> near_jump = NearDepthJumps(depth_m, kJumpReach, noise, threads);
  ParallelRows(height, threads, [&](int begin, int end) {
    // Of each column, the nearest and the farthest depth within kJumpReach rows; +inf and 0 where all are unknown.
    std::vector<float> nearest(width), farthest(width);
    for (int y = begin; y < end; ++y) {
      std::fill(nearest.begin(), nearest.end(), std::numeric_limits<float>::infinity());
      std::fill(farthest.begin(), farthest.end(), 0.0F);
      for (int ny = std::max(0, y - kJumpReach); ny <= std::min(height - 1, y + kJumpReach); ++ny) {
        const float* const row = depth_m.row(ny);
        for (int x = 0; x < width; ++x) {
          nearest[x] = row[x] > 0 && row[x] < nearest[x] ? row[x] : nearest[x];
          farthest[x] = row[x] > farthest[x] ? row[x] : farthest[x];
        }
      }
      for (int x = 0; x < width; ++x) {
        const float z = depth_m(x, y);
        if (z <= 0) continue;
        // The farthest another layer lies within two pixels: what being on the wrong side of the edge would cost.
        float step = 0;
        if (near_jump(x, y)) {
          float least = z, most = z;
          for (int nx = std::max(0, x - kJumpReach); nx <= std::min(width - 1, x + kJumpReach); ++nx)
            least = std::min(least, nearest[nx]), most = std::max(most, farthest[nx]);
          if (!SameLayer(z, most, noise)) step = most - z;
          if (!SameLayer(least, z, noise)) step = std::max(step, z - least);
        }
        const float mismatch = -kCostScale * std::log(fused.confidence(x, y));  // the cost again, sRGB units
        const float wrong_side = std::clamp(mismatch * kWrongSidePerCost, kLeastWrongSide, 0.5F) * step;
        const float spread = fused.spread_m(x, y);
        const float disagreement = (spread <= kModerate * z ? kSpreadOfOne : kSpreadOfTwo) * spread;
        const float drift = kDriftPerCost * mismatch * z;
        const Provenance seen = fused.provenance(x, y);
        const float guess = seen == Provenance::kInferred ? kGuess * z
                            : seen == Provenance::kOne    ? kUnconfirmed * z
                                                          : 0;
        const float sensor = kNoiseLeft * noise.At(z);
        const float variance =
            sensor * sensor + wrong_side * wrong_side + disagreement * disagreement + drift * drift + guess * guess;
        sigma(x, y) = std::sqrt(variance);
      }
    }
  });
  return sigma;
}

}  // namespace depthtween
