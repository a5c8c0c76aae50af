#include "core/upsample/choose.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include "core/base/lanes.h"
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

// How far the neighbours lie that each pixel of a checkerboard asks: good motions first jump, then spread.
constexpr int kSteps[][2] = {{11, 4}, {4, 1}, {1, 1}};

// The first proposal's match is looked at in one row and column of so many, and holds up to the next.
constexpr int kCostGrid = 4;

// The key pixel at a sub-pixel place, clamped to the image.
struct Pixel {
  int x, y;
};
Pixel NearestPixel(const Image<float>& image, float x, float y) {
  return {std::clamp(static_cast<int>(std::floor(x + 0.5F)), 0, image.width() - 1),
          std::clamp(static_cast<int>(std::floor(y + 0.5F)), 0, image.height() - 1)};
}

// What lies in the key at (x, y) costs, more than `limit` at least if it is more.
float CostOf(const MatchPatch& patch, const Key& key, float x, float y,
             float limit = std::numeric_limits<float>::max()) {
  const Pixel at = NearestPixel(key.distance, x, y);
  const float filled = key.distance(at.x, at.y);
  const float penalty =
      kFillPenalty * std::min(1.0F, filled / kFillReach) + kFillPenaltyPerPixel * std::min(kFillFar, filled);
  return penalty > limit ? penalty : patch.CostAt(key.image, x, y, limit - penalty) + penalty;
}

// The motions that a pixel compared: those closer than a quarter of a pixel are one.
class Tried {
 public:
  explicit Tried(Flow2 first) { u_[0] = first.u, v_[0] = first.v; }
  // False if it is one of them.
  bool Add(Flow2 m) {
    for (int i = 0; i < count_; ++i)
      if (std::abs(u_[i] - m.u) < kSame && std::abs(v_[i] - m.v) < kSame) return false;
    if (count_ < kMost) u_[count_] = m.u, v_[count_] = m.v, ++count_;
    return true;
  }

 private:
  static constexpr float kSame = 0.25F;  // pixels
  static constexpr int kMost = 17;
  float u_[kMost], v_[kMost];
  int count_ = 1;
};

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

// Marks the pixels from which the next to the right or below lies in another layer.
void MarkDepthJumps(ImageView<const float> depth_m, const DepthNoise& noise, int threads, Image<uint8_t>& jumps) {
  const int width = depth_m.width(), height = depth_m.height();
  // Marks pixels of `a` that lie in another layer than those of `b`.
  const auto mark = [noise](const float* a, const float* b, uint8_t* to, int count) {
    int x = 0;
    for (; x + kLanes <= count; x += kLanes) {
      const Lanes za = LoadLanes(a + x), zb = LoadLanes(b + x);
      const Lanes nearer = MinLanes(za, zb);
      const LaneInts other = ~(AbsLanes(za - zb) <= WidestGap(nearer, noise));
      typedef uint8_t Bytes __attribute__((vector_size(kLanes)));
      Bytes marked;
      std::memcpy(&marked, to + x, sizeof(marked));
      marked |= __builtin_convertvector(other & 1, Bytes);
      std::memcpy(to + x, &marked, sizeof(marked));
    }
    for (; x < count; ++x) to[x] |= static_cast<uint8_t>(!SameLayer(a[x], b[x], noise));
  };
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      mark(depth_m.row(y), depth_m.row(y) + 1, jumps.row(y), width - 1);
      if (y + 1 < height) mark(depth_m.row(y), depth_m.row(y + 1), jumps.row(y), width);
    }
  });
}

Image<uint8_t> Uncertain(const ChooseInput& input, const Choice& choice, int threads) {
  const SideChoice& before = choice.sides[0];
  const SideChoice& after = choice.sides[1];
  const bool two_sides = input.keys[1] != nullptr;
  Image<uint8_t> jumps(before.depth_m.width(), before.depth_m.height());
  MarkDepthJumps(before.depth_m, input.noise, threads, jumps);
  if (two_sides) MarkDepthJumps(after.depth_m, input.noise, threads, jumps);
  Image<uint8_t> mask = Dilate(jumps, kJumpRadius, threads);
  ParallelRows(mask.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < mask.width(); ++x) {
        const float a = before.depth_m(x, y), b = after.depth_m(x, y);
        const float cost = std::max(before.cost(x, y), after.cost(x, y));
        const bool agree = !two_sides || std::abs(a - b) <= kSidesDiffer * std::min(a, b);
        const auto thin = [&](int side) {
          if (input.thin[side].empty()) return false;
          const Flow2 m = input.thin[side](x, y);
          return m.u != 0 || m.v != 0;
        };
        mask(x, y) = mask(x, y) || !agree || cost > kHighCost || thin(0) || thin(1);
        if (!mask(x, y) || !two_sides || !agree || cost >= kConfirmedCost) continue;
        const auto measured = [&](int s) {
          const Flow2 m = choice.sides[s].motion(x, y);
          const Image<float>& filled = input.keys[s]->distance;
          const Pixel at = NearestPixel(filled, static_cast<float>(x) + m.u, static_cast<float>(y) + m.v);
          return filled(at.x, at.y) == 0;
        };
        mask(x, y) = !(measured(0) && measured(1));
      }
  });
  return mask;
}

// The sum of those of four depths (z00, z10, z01, z11 with their weights) that lie in the layer of the one that weighs
// most.
float MeanInLayer(const std::array<float, 4>& z, const std::array<float, 4>& w, float nearest,
                  const DepthNoise& noise) {
  if (nearest <= 0) return 0.0F;
  float sum = 0, weight = 0;
  for (int i = 0; i < 4; ++i)
    if (z[i] > 0 && SameLayer(z[i], nearest, noise)) sum += w[i] * z[i], weight += w[i];
  return weight > 0 ? sum / weight : nearest;
}

inline float SampleInLayer(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise) {
  x = std::clamp(x, 0.0F, static_cast<float>(depth_m.width() - 1));
  y = std::clamp(y, 0.0F, static_cast<float>(depth_m.height() - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float* const top = depth_m.row(y0) + x0;
  const float* const bottom = y0 + 1 < depth_m.height() ? top + depth_m.stride() : top;
  const int right = x0 + 1 < depth_m.width() ? 1 : 0;
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const float z00 = top[0], z10 = top[right], z01 = bottom[0], z11 = bottom[right];
  const float w00 = (1 - ax) * (1 - ay), w10 = ax * (1 - ay), w01 = (1 - ax) * ay, w11 = ax * ay;
  const float least = std::min(std::min(z00, z10), std::min(z01, z11));
  const float most = std::max(std::max(z00, z10), std::max(z01, z11));
  if (least > 0 && most - least <= kLayerGap * least) return w00 * z00 + w10 * z10 + w01 * z01 + w11 * z11;
  const float nearest = ay < 0.5F ? (ax < 0.5F ? z00 : z10) : (ax < 0.5F ? z01 : z11);
  return MeanInLayer({z00, z10, z01, z11}, {w00, w10, w01, w11}, nearest, noise);
}

// One choice in the making: the first proposal of every pixel, its match, sweeps of search where that is uncertain, and
// depth at last. Rows are split over threads; within a step no row reads what another writes.
class Search {
 public:
  Search(const ChooseInput& input, int threads)
      : input_(input),
        threads_(threads),
        width_(input.target->width()),
        height_(input.target->height()),
        sides_(input.keys[1] == nullptr ? 1 : 2) {
    for (SideChoice& side : choice_.sides)
      side = {Image<Flow2>(width_, height_), Image<float>(width_, height_), Image<float>(width_, height_)};
    if (input.tau > 0.02F && input.tau < 0.98F) mirror_ = {-input.tau / (1 - input.tau), -(1 - input.tau) / input.tau};
  }

  void TakeFirstProposals() {
    ParallelRows(height_, threads_, [&](int begin, int end) {
      for (int s = 0; s < sides_; ++s) {
        SideChoice& side = choice_.sides[s];
        for (int y = begin; y < end; ++y) {
          const Flow2* const proposed = input_.proposals[s][0].row(y);
          std::copy_n(proposed, width_, side.motion.row(y));
          float* const depth = side.depth_m.row(y);
          for (int x = 0; x < width_; ++x) depth[x] = DepthAt(s, x, y, proposed[x]);
        }
      }
    });
  }

  // In the middle of each cell of a grid; a row of cells is one item.
  void CostFirstProposals() {
    ParallelRows((height_ + kCostGrid - 1) / kCostGrid, threads_,
                 [&](int begin, int end) {
                   for (int row = begin; row < end; ++row) CostRowOfCells(row * kCostGrid);
                 },
                 /*band=*/4);
  }

  void MarkUncertain() { choice_.uncertain = Uncertain(input_, choice_, threads_); }

  // Compares the other proposals and, sweep by sweep, what the neighbours and the other side found. Each sweep reads
  // the one before, so that the order of pixels does not matter.
  void Sweep(int sweep) {
    constexpr int kBand = 16;
    std::vector<std::vector<Found>> found((height_ + kBand - 1) / kBand);
    ParallelRows(
        height_, threads_,
        [&](int begin, int end) {
          for (int y = begin; y < end; ++y)
            for (int x = 0; x < width_; ++x)
              if (choice_.uncertain(x, y)) SearchPixel(sweep, x, y, found[begin / kBand]);
        },
        kBand);
    for (const std::vector<Found>& better : found)
      for (const Found& f : better) choice_.sides[f.side].motion(f.x, f.y) = f.motion;
  }

  Choice Finish() && {
    ParallelRows(height_, threads_, [&](int begin, int end) {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < width_; ++x)
          if (choice_.uncertain(x, y))
            for (int s = 0; s < sides_; ++s)
              choice_.sides[s].depth_m(x, y) = DepthAt(s, x, y, choice_.sides[s].motion(x, y));
    });
    return std::move(choice_);
  }

 private:
  // What a sweep found, to be written once all have read.
  struct Found {
    int x, y, side;
    Flow2 motion;
  };

  float DepthAt(int s, int x, int y, Flow2 m) const {
    return SampleInLayer(input_.keys[s]->depth_m, static_cast<float>(x) + m.u, static_cast<float>(y) + m.v,
                         input_.noise);
  }
  float CostAt(const MatchPatch& patch, int s, int x, int y, Flow2 m,
               float limit = std::numeric_limits<float>::max()) const {
    return CostOf(patch, *input_.keys[s], static_cast<float>(x) + m.u, static_cast<float>(y) + m.v, limit);
  }

  void CostRowOfCells(int top) {
    const int bottom = std::min(height_, top + kCostGrid), y = (top + bottom) / 2;
    for (int left = 0; left < width_; left += kCostGrid) {
      const int right = std::min(width_, left + kCostGrid), x = (left + right) / 2;
      const MatchPatch patch(*input_.target, x, y);
      for (int s = 0; s < sides_; ++s)
        std::fill(choice_.sides[s].cost.row(top) + left, choice_.sides[s].cost.row(top) + right,
                  CostAt(patch, s, x, y, input_.proposals[s][0](x, y)));
    }
    for (int s = 0; s < sides_; ++s)
      for (int y2 = top + 1; y2 < bottom; ++y2)
        std::copy_n(choice_.sides[s].cost.row(top), width_, choice_.sides[s].cost.row(y2));
  }

  void SearchPixel(int sweep, int x, int y, std::vector<Found>& better) {
    if (sweep > 0 && choice_.sides[0].cost(x, y) < kGoodCost && (sides_ < 2 || choice_.sides[1].cost(x, y) < kGoodCost))
      return;
    const MatchPatch patch(*input_.target, x, y);
    for (int s = 0; s < sides_; ++s) {
      SideChoice& side = choice_.sides[s];
      const Flow2 incumbent = side.motion(x, y);
      if (sweep == 0) side.cost(x, y) = CostAt(patch, s, x, y, incumbent);
      float best_cost = side.cost(x, y);
      if (best_cost < kGoodCost) continue;
      Flow2 best = incumbent;
      Tried tried(incumbent);
      const auto propose = [&](Flow2 m) {
        if (!tried.Add(m)) return;
        const float cost = CostAt(patch, s, x, y, m, best_cost - kMargin);
        if (cost < best_cost - kMargin) best = m, best_cost = cost;
      };
      if (sweep == 0)
        for (size_t i = 1; i < input_.proposals[s].size(); ++i) propose(input_.proposals[s][i](x, y));
      if (sides_ == 2 && mirror_[s] != 0) {
        const Flow2 o = choice_.sides[1 - s].motion(x, y);
        propose({mirror_[s] * o.u, mirror_[s] * o.v});
      }
      const int step = kSteps[std::min(sweep, 2)][(x + y) % 2];
      for (const auto& [dx, dy] : {std::pair{0, -step}, {-step, 0}, {step, 0}, {0, step}})
        if (side.motion.Contains(x + dx, y + dy)) propose(side.motion(x + dx, y + dy));
      if (best_cost < side.cost(x, y)) better.push_back({x, y, s, best});
      side.cost(x, y) = best_cost;
    }
  }

  const ChooseInput& input_;
  const int threads_, width_, height_, sides_;
  // The other side's motion times this is this side's, for straight and even motion; 0 too near to a key to tell.
  std::array<float, 2> mirror_ = {};
  Choice choice_;
};

}  // namespace

float SampleDepthInLayer(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise) {
  return SampleInLayer(depth_m, x, y, noise);
}

Image<uint8_t> NearDepthJumps(ImageView<const float> depth_m, int radius, const DepthNoise& noise, int threads) {
  Image<uint8_t> jumps(depth_m.width(), depth_m.height());
  MarkDepthJumps(depth_m, noise, threads, jumps);
  return Dilate(jumps, radius, threads);
}

Choice Choose(const ChooseInput& input, const ChooseOptions& options, int threads) {
  Search search(input, threads);
  search.TakeFirstProposals();
  search.CostFirstProposals();
  search.MarkUncertain();
  for (int sweep = 0; sweep < options.sweeps; ++sweep) search.Sweep(sweep);
  return std::move(search).Finish();
}

}  // namespace depthtween
