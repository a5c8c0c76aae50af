#include "core/upsample/fuse.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

constexpr float kAgree = 0.05F;     // share of depth: one surface, seen twice
constexpr float kModerate = 0.20F;  // share of depth: one surface that moved in depth, if both match
constexpr float kEqualCost = 2.0F;  // sRGB units
constexpr float kCostScale = 4.0F;  // a match worse by this counts 1/e
constexpr float kTimeCost = 1.0F;   // what the far end of the interval costs the far key, sRGB units
constexpr int kJumpReach = 2;       // pixels from a silhouette where its wrong side is a danger
// Standard deviations, fitted by hand to the reliability curves of rendered and real recordings together (evaluate):
// real sensors misplace their edges, rendered ones do not, so one is a little underrated and the other overrated.
constexpr float kSpreadOfOne = 0.5F;   // of what two answers about one surface differ by
constexpr float kSpreadOfTwo = 0.15F;  // of what answers about two surfaces differ by
constexpr float kWrongSidePerCost = 1.0F / 40.0F, kLeastWrongSide = 0.05F;  // of the step at a silhouette
constexpr float kDriftPerCost = 0.0004F;                                    // of depth
constexpr float kGuess = 0.02F;                                             // of depth, where neither key saw it
constexpr float kSeenDistance = 1.5F;  // a key pixel nearer than this to a measurement counts as seen

float DistanceAt(const Key& key, int x, int y, Flow2 m) {
  const int nx = static_cast<int>(std::lround(static_cast<float>(x) + m.u));
  const int ny = static_cast<int>(std::lround(static_cast<float>(y) + m.v));
  if (!key.distance.Contains(nx, ny)) return 1e9F;
  return key.distance(nx, ny);
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
        const float distance0 = DistanceAt(*input.keys[0], x, y, choice.sides[0].motion(x, y));
        const float distance1 = DistanceAt(*input.keys[1], x, y, choice.sides[1].motion(x, y));
        const bool seen0 = distance0 < kSeenDistance, seen1 = distance1 < kSeenDistance;
        const float nearer = std::min(z0, z1), gap = std::abs(z0 - z1);
        if (nearer > 0) out.spread_m(x, y) = gap;
        const bool first = z1 <= 0 || (z0 > 0 && c0 <= c1);
        if (nearer > 0 && gap <= kAgree * nearer) {
          const float w0 = (1 - tau + 0.01F) * std::exp(-c0 / kCostScale),
                      w1 = (tau + 0.01F) * std::exp(-c1 / kCostScale);
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
        out.confidence(x, y) = std::exp(-(first ? c0 : c1) / kCostScale) + 1e-3F;
      }
  });
  return out;
}

Image<float> PredictSigma(ImageView<const float> depth_m, const Fused& fused, const DepthNoise& noise, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  Image<float> sigma(width, height);
  const Image<uint8_t> near_jump = NearDepthJumps(depth_m, kJumpReach, noise, threads);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const float z = depth_m(x, y);
        if (z <= 0) continue;
        // The farthest another layer lies within two pixels: what being on the wrong side of the edge would cost.
        float step = 0;
        for (int dy = -kJumpReach; near_jump(x, y) && dy <= kJumpReach; ++dy)
          for (int dx = -kJumpReach; dx <= kJumpReach; ++dx) {
            const float other = depth_m.Clamped(x + dx, y + dy);
            if (other > 0 && !SameLayer(z, other, noise)) step = std::max(step, std::abs(other - z));
          }
        const float mismatch = -kCostScale * std::log(fused.confidence(x, y));  // the cost again, sRGB units
        const float wrong_side = std::clamp(mismatch * kWrongSidePerCost, kLeastWrongSide, 0.5F) * step;
        const float spread = fused.spread_m(x, y);
        const float disagreement = (spread <= kModerate * z ? kSpreadOfOne : kSpreadOfTwo) * spread;
        const float drift = kDriftPerCost * mismatch * z;
        const float guess = fused.provenance(x, y) == Provenance::kInferred ? kGuess * z : 0.0F;
        const float variance = noise.At(z) * noise.At(z) + wrong_side * wrong_side + disagreement * disagreement +
                               drift * drift + guess * guess;
        sigma(x, y) = std::sqrt(variance);
      }
  });
  return sigma;
}

}  // namespace depthtween
