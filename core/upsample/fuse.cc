#include "core/upsample/fuse.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

constexpr float kAgree = 0.05F;     // share of depth: one surface, seen twice
constexpr float kEqualCost = 2.0F;  // sRGB units
constexpr float kTimeCost = 1.0F;   // what the far end of the interval costs the far key, sRGB units
// Neighbours that tell how a surface moves in depth: so far away at most, one in so many pixels each way. So many of
// them at least must lie in the pixel's layer.
constexpr int kReach = 15, kStride = 5, kFewest = 5;
// A change that three in four neighbours share within this share of depth is that of their surface, not of another
// one's, unless one match is worse by more than the cost, sRGB units.
constexpr float kShared = 0.025F, kSharedCost = 8.0F;
// A surface that goes from one depth to another appears larger by their ratio. What it is seen to grow by may differ by
// this share of that, in logarithms, since it may turn as well; its colours, seen larger or smaller, may match worse by
// the cost; and so many neighbours at least must tell.
constexpr float kGrowth = 0.4F, kTravelledCost = 16.0F;
constexpr size_t kFewestTelling = 10;
// The changes of neighbours about whom the keys agree count by their mean if they deviate by less than this share of
// depth from it ...
constexpr float kSteady = 0.015F;
// ... and differ from none by so many deviations of that mean.
constexpr float kTelling = 4.0F;
constexpr float kSeenDistance = 1.5F;  // a key pixel nearer than this to a measurement counts as seen

// How far the pixel of a key at the end of a motion is from a measurement: far from everything where there is no key.
class DistanceInKey {
 public:
  explicit DistanceInKey(const Key* key) {
    if (key != nullptr) distance_ = key->distance;
  }
  float At(int x, int y, Flow2 m) const {
    constexpr float kFar = 1e9F;
    const int nx = static_cast<int>(std::floor(static_cast<float>(x) + m.u + 0.5F));
    const int ny = static_cast<int>(std::floor(static_cast<float>(y) + m.v + 0.5F));
    return distance_.Contains(nx, ny) ? distance_(nx, ny) : kFar;
  }

 private:
  ImageView<const float> distance_;
};

// By how much places of a target frame are further apart in the second key than in the first.
class Growth {
 public:
  // A place at (dx, dy) from another that stays the same, and its motions to the keys.
  void Add(int dx, int dy, Flow2 to_first, Flow2 to_second) {
    const auto x = static_cast<float>(dx), y = static_cast<float>(dy);
    const float u0 = x + to_first.u, v0 = y + to_first.v, u1 = x + to_second.u, v1 = y + to_second.v;
    ++count_;
    u0_ += u0, v0_ += v0, u1_ += u1, v1_ += v1;
    squares_ += u0 * u0 + v0 * v0;
    products_ += u0 * u1 + v0 * v1;
  }
  bool Is(float ratio) const {
    const auto n = static_cast<float>(count_);
    const float variance = squares_ - (u0_ * u0_ + v0_ * v0_) / n, covariance = products_ - (u0_ * u1_ + v0_ * v1_) / n;
    if (variance <= 0 || covariance <= 0) return false;
    const float expected = std::log(ratio);
    return std::abs(std::log(covariance / variance) - expected) <= kGrowth * std::abs(expected);
  }

 private:
  int count_ = 0;
  float u0_ = 0, v0_ = 0, u1_ = 0, v1_ = 0, squares_ = 0, products_ = 0;
};

// How the keys' answers change, from the first to the second, around a pixel in the layer of what one of them says
// there.
struct SurfaceChange {
  bool shared = false;  // the pixel's own change is that of most neighbours
  float mean_m = 0;     // of neighbours about whom the keys agree; 0 where that tells nothing
};
SurfaceChange ChangeAround(const Choice& choice, int x, int y, int side, const DepthNoise& noise) {
  const Image<float>& z0 = choice.sides[0].depth_m;
  const Image<float>& z1 = choice.sides[1].depth_m;
  const float here = choice.sides[side].depth_m(x, y);
  const bool two = z0(x, y) > 0 && z1(x, y) > 0;
  const float change = z1(x, y) - z0(x, y);
  int count = 0, like = 0, agreeing = 0;
  float sum = 0, squares = 0;
  for (int ny = y - kReach; ny <= y + kReach; ny += kStride)
    for (int nx = x - kReach; nx <= x + kReach; nx += kStride) {
      if (!z0.Contains(nx, ny)) continue;
      const float a = z0(nx, ny), b = z1(nx, ny), nearer = std::min(a, b), d = b - a;
      if (nearer <= 0 || std::abs(d) > kOneSurface * nearer || !SameLayer(side == 0 ? a : b, here, noise)) continue;
      ++count;
      like += two && std::abs(d - change) <= kShared * here;
      if (std::abs(d) <= kAgree * nearer) ++agreeing, sum += d, squares += d * d;
    }
  SurfaceChange result{.shared = count >= kFewest && 4 * like >= 3 * count};
  if (agreeing >= kFewest) {
    const float mean = sum / static_cast<float>(agreeing);
    const float variance = squares / static_cast<float>(agreeing) - mean * mean;
    if (variance <= kSteady * kSteady * here * here &&
        mean * mean * static_cast<float>(agreeing) > kTelling * kTelling * variance)
      result.mean_m = mean;
  }
  return result;
}

// The change that three in four neighbours of the pixel's layer share, however large, if they move apart as places of a
// surface do that changes its depth so. 0 if there is none.
float TravelAround(const Choice& choice, int x, int y, int side, const DepthNoise& noise) {
  const SideChoice &first = choice.sides[0], &second = choice.sides[1];
  const float here = choice.sides[side].depth_m(x, y);
  constexpr int kAcross = 2 * kReach / kStride + 1;
  constexpr size_t kMost = kAcross * kAcross;
  std::array<std::pair<int, int>, kMost> places{};
  std::array<float, kMost> changes{}, sorted{};
  size_t count = 0;
  for (int ny = y - kReach; ny <= y + kReach; ny += kStride)
    for (int nx = x - kReach; nx <= x + kReach; nx += kStride) {
      if (!first.depth_m.Contains(nx, ny)) continue;
      const float a = first.depth_m(nx, ny), b = second.depth_m(nx, ny);
      if (a <= 0 || b <= 0 || !SameLayer(side == 0 ? a : b, here, noise)) continue;
      places[count] = {nx, ny};
      changes[count++] = b - a;
    }
  if (count < kFewestTelling) return 0;
  // Of values three quarters of which are close together, the middle one is among those.
  std::copy_n(changes.begin(), count, sorted.begin());
  std::nth_element(sorted.begin(), sorted.begin() + count / 2, sorted.begin() + count);
  const float change = sorted[count / 2];
  Growth growth;
  size_t like = 0;
  for (size_t i = 0; i < count; ++i) {
    if (std::abs(changes[i] - change) > kShared * here) continue;
    const auto [nx, ny] = places[i];
    growth.Add(nx - x, ny - y, first.motion(nx, ny), second.motion(nx, ny));
    ++like;
  }
  const float before = side == 0 ? here : here - change, after = side == 0 ? here + change : here;
  if (4 * like < 3 * count || before <= 0 || after <= 0 || !growth.Is(before / after)) return 0;
  return change;
}

// The mean changes of surfaces on a grid of pixels, for the pixels between them that lie in the same layer.
class ChangeGrid {
 public:
  ChangeGrid(const Choice& choice, const DepthNoise& noise, int threads)
      : noise_(noise),
        before_m_(choice.uncertain.width() / kCell + 1, choice.uncertain.height() / kCell + 1),
        mean_m_(before_m_.width(), before_m_.height()) {
    const Image<float>& z0 = choice.sides[0].depth_m;
    const Image<float>& z1 = choice.sides[1].depth_m;
    ParallelFor(mean_m_.height(), threads, [&](int row) {
      const int y = std::min(z0.height() - 1, row * kCell + kCell / 2);
      for (int column = 0; column < mean_m_.width(); ++column) {
        const int x = std::min(z0.width() - 1, column * kCell + kCell / 2);
        const float a = z0(x, y), b = z1(x, y);
        if (a <= 0 || b <= 0 || std::abs(b - a) > kAgree * std::min(a, b)) continue;
        before_m_(column, row) = a;
        mean_m_(column, row) = ChangeAround(choice, x, y, 0, noise).mean_m;
      }
    });
  }

  // 0 where no surface of the layer is near.
  float At(int x, int y, float before_m) const {
    const int column = x / kCell, row = y / kCell;
    const float own = before_m_(column, row);
    if (own > 0 && SameLayer(own, before_m, noise_)) return mean_m_(column, row);
    return OfNeighbour(column, row, before_m);
  }

 private:
  static constexpr int kCell = 8;
  static constexpr std::pair<int, int> kNeighbours[] = {{-1, 0},  {1, 0},  {0, -1}, {0, 1},
                                                        {-1, -1}, {1, -1}, {-1, 1}, {1, 1}};

  float OfNeighbour(int column, int row, float before_m) const {
    for (const auto& [dx, dy] : kNeighbours)
      if (before_m_.Contains(column + dx, row + dy)) {
        const float there = before_m_(column + dx, row + dy);
        if (there > 0 && SameLayer(there, before_m, noise_)) return mean_m_(column + dx, row + dy);
      }
    return 0;
  }

  const DepthNoise noise_;
  Image<float> before_m_;  // what the first key says at the grid's pixels; 0 where the keys do not agree
  Image<float> mean_m_;
};

}  // namespace

Fused Fuse(const ChooseInput& input, const Choice& choice, int threads) {
  const int width = choice.uncertain.width(), height = choice.uncertain.height();
  const float tau = std::clamp(input.tau, 0.0F, 1.0F);
  Fused out{Image<float>(width, height),      Image<float>(width, height),   Image<float>(width, height),
            Image<Provenance>(width, height), Image<uint8_t>(width, height), Image<uint8_t>(width, height)};
  const ChangeGrid changes(choice, input.noise, threads);
  const SideChoice &before = choice.sides[0], &after = choice.sides[1];
  const DistanceInKey in_before(input.keys[0]), in_after(input.keys[1]);
  // By value, and row by row: single bytes written here could be anything to the compiler, which would then read all it
  // knows anew for each pixel.
  ParallelRows(height, threads, [&, tau, in_before, in_after](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      const float *const all_z0 = before.depth_m.row(y), *const all_z1 = after.depth_m.row(y);
      const float *const costs0 = before.cost.row(y), *const costs1 = after.cost.row(y);
      const Flow2 *const motions0 = before.motion.row(y), *const motions1 = after.motion.row(y);
      float *const depths = out.depth_m.row(y), *const all_changes = out.change_m.row(y);
      float* const confidences = out.confidence.row(y);
      Provenance* const provenances = out.provenance.row(y);
      uint8_t *const all_travelled = out.travelled.row(y), *const all_confirmed = out.confirmed.row(y);
      for (int x = 0; x < width; ++x) {
        const float z0 = all_z0[x], z1 = all_z1[x];
        if (z0 <= 0 && z1 <= 0) continue;
        const float c0 = costs0[x] + kTimeCost * tau, c1 = costs1[x] + kTimeCost * (1 - tau);
        const float fit0 = std::exp(-c0 / kCostScale), fit1 = std::exp(-c1 / kCostScale);
        const float nearer = std::min(z0, z1), gap = std::abs(z0 - z1), costs_differ = std::abs(c0 - c1);
        const bool first = z1 <= 0 || (z0 > 0 && c0 <= c1);
        const bool agree = nearer > 0 && gap <= kAgree * nearer;
        const float linear = (1 - tau) * z0 + tau * z1;
        bool by_both = true;
        if (agree) {
          const float w0 = (1 - tau + 0.01F) * fit0, w1 = (tau + 0.01F) * fit1;
          const float change = changes.At(x, y, z0);
          const float now0 = z0 + tau * change, now1 = z1 - (1 - tau) * change;
          depths[x] = w0 + w1 > 0 ? (w0 * now0 + w1 * now1) / (w0 + w1) : linear;
        } else if (nearer > 0 && gap <= kOneSurface * nearer && costs_differ <= kEqualCost) {
          depths[x] = linear;
        } else {
          const SurfaceChange around = ChangeAround(choice, x, y, first ? 0 : 1, input.noise);
          const bool shared = around.shared && gap <= kOneSurface * nearer && costs_differ <= kSharedCost;
          const float travel = shared ? 0 : TravelAround(choice, x, y, first ? 0 : 1, input.noise);
          const bool travelled = travel != 0 && nearer > 0 && costs_differ <= kTravelledCost &&
                                 std::abs(z1 - z0 - travel) <= kShared * (first ? z0 : z1);
          const float change = travel != 0 ? travel : around.mean_m;
          depths[x] = shared || travelled ? linear : first ? z0 + tau * change : z1 - (1 - tau) * change;
          all_travelled[x] = travelled;
          by_both = travelled;
        }
        if (nearer > 0) all_changes[x] = z1 - z0;
        confidences[x] = (first ? fit0 : fit1) + 1e-3F;
        const float distance0 = in_before.At(x, y, motions0[x]), distance1 = in_after.At(x, y, motions1[x]);
        all_confirmed[x] = agree && distance0 == 0 && distance1 == 0;
        const bool seen0 = distance0 < kSeenDistance && (by_both || first);
        const bool seen1 = distance1 < kSeenDistance && (by_both || !first);
        provenances[x] = seen0 && seen1 ? Provenance::kBoth : seen0 || seen1 ? Provenance::kOne : Provenance::kInferred;
      }
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
