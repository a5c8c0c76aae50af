#include "core/upsample/choose.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// Uncertain: this near to a depth jump, pixels ...
constexpr int kJumpRadius = 3;
// ... or a match worse than this, sRGB units (noise of a good camera costs 2-4, motion blur 10) ...
constexpr float kHighCost = 20.0F;
// ... or sides that differ by more than this share of depth.
constexpr float kSidesDiffer = 0.05F;
// A motion onto a filled pixel of the key costs this much more, reached at kFillReach pixels from a measurement, ...
constexpr float kFillPenalty = 3.0F;
constexpr float kFillReach = 3.0F;
// ... and this much more for each further pixel: what lies far inside a hole is a guess, however well its colours
// match.
constexpr float kFillPenaltyPerPixel = 0.6F;
constexpr float kFillFar = 40.0F;
// A proposal must beat the incumbent by this much, so that on plain walls equal matches do not wander.
constexpr float kMargin = 0.5F;
// A match this good cannot be bettered by more than noise.
constexpr float kGoodCost = 6.0F;
// Two keys that measured the pixel, agree and match at least this well leave nothing to search for.
constexpr float kConfirmedCost = 8.0F;

// The first proposal's match is looked at in one row and column of so many, and holds up to the next.
constexpr int kCostGrid = 2;

// The key pixel at a sub-pixel place, clamped to the image.
struct Pixel {
  int x, y;
};
Pixel NearestPixel(const Image<float>& image, float x, float y) {
  return {std::clamp(static_cast<int>(std::floor(x + 0.5F)), 0, image.width() - 1),
          std::clamp(static_cast<int>(std::floor(y + 0.5F)), 0, image.height() - 1)};
}

float CostOf(const MatchPatch& patch, const Key& key, float x, float y, float limit = MatchPatch::kTruncation) {
  const Pixel at = NearestPixel(key.distance, x, y);
  const float filled = key.distance(at.x, at.y);
  return patch.CostAt(key.image, x, y, limit) + kFillPenalty * std::min(1.0F, filled / kFillReach) +
         kFillPenaltyPerPixel * std::min(kFillFar, filled);
}

// to |= from, pixel by pixel.
void Unite(const uint8_t* __restrict from, uint8_t* __restrict to, int count) {
  for (int x = 0; x < count; ++x) to[x] |= from[x];
}

// Separable dilation of a 0/1 mask by a square.
Image<uint8_t> Dilate(const Image<uint8_t>& mask, int radius, int threads) {
  const int width = mask.width(), height = mask.height();
  Image<uint8_t> rows(width, height), out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int dx = std::max(-radius, 1 - width); dx <= std::min(radius, width - 1); ++dx)
        Unite(mask.row(y) + std::max(0, dx), rows.row(y) + std::max(0, -dx), width - std::abs(dx));
  });
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int ny = std::max(0, y - radius); ny <= std::min(height - 1, y + radius); ++ny)
        Unite(rows.row(ny), out.row(y), width);
  });
  return out;
}

Image<uint8_t> Uncertain(const ChooseInput& input, const Choice& choice, int threads) {
  const SideChoice& before = choice.sides[0];
  const SideChoice& after = choice.sides[1];
  const bool two_sides = input.keys[1] != nullptr;
  Image<uint8_t> mask = NearDepthJumps(before.depth_m, kJumpRadius, input.noise, threads);
  const Image<uint8_t> other = NearDepthJumps(after.depth_m, kJumpRadius, input.noise, threads);
  ParallelRows(mask.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < mask.width(); ++x) {
        const float a = before.depth_m(x, y), b = after.depth_m(x, y);
        const float cost = std::max(before.cost(x, y), after.cost(x, y));
        const bool agree = !two_sides || std::abs(a - b) <= kSidesDiffer * std::min(a, b);
        const auto measured = [&](int s) {
          const Flow2 m = choice.sides[s].motion(x, y);
          const Image<float>& filled = input.keys[s]->distance;
          const Pixel at = NearestPixel(filled, static_cast<float>(x) + m.u, static_cast<float>(y) + m.v);
          return filled(at.x, at.y) == 0;
        };
        const bool confirmed = two_sides && agree && cost < kConfirmedCost && measured(0) && measured(1);
        mask(x, y) = !confirmed && (mask(x, y) || other(x, y) || !agree || cost > kHighCost);
      }
  });
  return mask;
}

}  // namespace

float SampleDepthInLayer(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise) {
  x = std::clamp(x, 0.0F, static_cast<float>(depth_m.width() - 1));
  y = std::clamp(y, 0.0F, static_cast<float>(depth_m.height() - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, depth_m.width() - 1), y1 = std::min(y0 + 1, depth_m.height() - 1);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const float z00 = depth_m(x0, y0), z10 = depth_m(x1, y0), z01 = depth_m(x0, y1), z11 = depth_m(x1, y1);
  const float w00 = (1 - ax) * (1 - ay), w10 = ax * (1 - ay), w01 = (1 - ax) * ay, w11 = ax * ay;
  const float least = std::min({z00, z10, z01, z11}), most = std::max({z00, z10, z01, z11});
  if (least > 0 && most - least <= kLayerGap * least) return w00 * z00 + w10 * z10 + w01 * z01 + w11 * z11;
  const float nearest = ay < 0.5F ? (ax < 0.5F ? z00 : z10) : (ax < 0.5F ? z01 : z11);
  if (nearest <= 0) return 0.0F;
  float sum = 0, weight = 0;
  const auto add = [&](float z, float w) {
    if (z > 0 && SameLayer(z, nearest, noise)) sum += w * z, weight += w;
  };
  add(z00, w00);
  add(z10, w10);
  add(z01, w01);
  add(z11, w11);
  return weight > 0 ? sum / weight : nearest;
}

Image<uint8_t> NearDepthJumps(ImageView<const float> depth_m, int radius, const DepthNoise& noise, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  Image<uint8_t> jumps(width, height);
  // Marks pixels of `a` that lie in another layer than those of `b`.
  const auto mark = [noise](const float* __restrict a, const float* __restrict b, uint8_t* __restrict to, int count) {
    for (int x = 0; x < count; ++x) to[x] |= static_cast<uint8_t>(!SameLayer(a[x], b[x], noise));
  };
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      mark(depth_m.row(y), depth_m.row(y) + 1, jumps.row(y), width - 1);
      if (y + 1 < height) mark(depth_m.row(y), depth_m.row(y + 1), jumps.row(y), width);
    }
  });
  return Dilate(jumps, radius, threads);
}

Choice Choose(const ChooseInput& input, const ChooseOptions& options, int threads) {
  const MatchImage& target = *input.target;
  const int width = target.width(), height = target.height();
  const int sides = input.keys[1] == nullptr ? 1 : 2;
  Choice choice;
  for (SideChoice& side : choice.sides)
    side = {Image<Flow2>(width, height), Image<float>(width, height), Image<float>(width, height)};

  const auto depth_at = [&](int s, int x, int y, Flow2 m) {
    return SampleDepthInLayer(input.keys[s]->depth_m, static_cast<float>(x) + m.u, static_cast<float>(y) + m.v,
                              input.noise);
  };
  // The first proposal, everywhere.
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const bool on_grid = x % kCostGrid == 0 && y % kCostGrid == 0;
        const std::optional<MatchPatch> patch = on_grid ? std::make_optional<MatchPatch>(target, x, y) : std::nullopt;
        for (int s = 0; s < sides; ++s) {
          const Flow2 m = input.proposals[s][0](x, y);
          choice.sides[s].motion(x, y) = m;
          choice.sides[s].depth_m(x, y) = depth_at(s, x, y, m);
          choice.sides[s].cost(x, y) =
              on_grid ? CostOf(*patch, *input.keys[s], static_cast<float>(x) + m.u, static_cast<float>(y) + m.v)
                      : choice.sides[s].cost(x - x % kCostGrid, y - y % kCostGrid);
        }
      }
  });
  choice.uncertain = Uncertain(input, choice, threads);

  // Where uncertain: the other proposals and, sweep by sweep, what the neighbours and the other side found. Each sweep
  // reads the one before, so that the order of pixels does not matter.
  const float mirror[2] = {input.tau > 0.02F && input.tau < 0.98F ? -input.tau / (1 - input.tau) : 0.0F,
                           input.tau > 0.02F && input.tau < 0.98F ? -(1 - input.tau) / input.tau : 0.0F};
  // How far the neighbours lie that each pixel of a checkerboard asks: good motions first jump, then spread.
  constexpr int kSteps[][2] = {{11, 4}, {4, 1}, {1, 1}};
  for (int sweep = 0; sweep < options.sweeps; ++sweep) {
    const Image<Flow2> previous[2] = {choice.sides[0].motion.Clone(), choice.sides[1].motion.Clone()};
    ParallelRows(height, threads, [&](int begin, int end) {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < width; ++x) {
          if (!choice.uncertain(x, y)) continue;
          const MatchPatch patch(target, x, y);
          for (int s = 0; s < sides; ++s) {
            SideChoice& side = choice.sides[s];
            Flow2 best = previous[s](x, y);
            float best_cost = sweep > 0 ? side.cost(x, y)
                                        : CostOf(patch, *input.keys[s], static_cast<float>(x) + best.u,
                                                 static_cast<float>(y) + best.v);
            side.cost(x, y) = best_cost;
            if (best_cost < kGoodCost) continue;
            std::array<Flow2, 16> tried;
            size_t tried_count = 0;
            const auto propose = [&](Flow2 m) {
              // Motions closer than a quarter of a pixel are one.
              const auto near = [&](Flow2 t) { return std::abs(t.u - m.u) < 0.25F && std::abs(t.v - m.v) < 0.25F; };
              if (near(previous[s](x, y)) || std::any_of(tried.begin(), tried.begin() + tried_count, near)) return;
              if (tried_count < tried.size()) tried[tried_count++] = m;
              const float cost =
                  CostOf(patch, *input.keys[s], static_cast<float>(x) + m.u, static_cast<float>(y) + m.v, best_cost);
              if (cost < best_cost - kMargin) best = m, best_cost = cost;
            };
            if (sweep == 0)
              for (size_t i = 1; i < input.proposals[s].size(); ++i) propose(input.proposals[s][i](x, y));
            if (sides == 2 && mirror[s] != 0) {
              const Flow2 o = previous[1 - s](x, y);
              propose({mirror[s] * o.u, mirror[s] * o.v});
            }
            const int step = kSteps[std::min(sweep, 2)][(x + y) % 2];
            for (int dy = -step; dy <= step; dy += step)
              for (int dx = -step; dx <= step; dx += step)
                if ((dx != 0 || dy != 0) && previous[s].Contains(x + dx, y + dy)) propose(previous[s](x + dx, y + dy));
            side.motion(x, y) = best;
            side.cost(x, y) = best_cost;
          }
        }
    });
  }
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x)
        if (choice.uncertain(x, y))
          for (int s = 0; s < sides; ++s)
            choice.sides[s].depth_m(x, y) = depth_at(s, x, y, choice.sides[s].motion(x, y));
  });
  return choice;
}

}  // namespace depthtween
