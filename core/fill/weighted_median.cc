#include "core/fill/weighted_median.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "core/base/parallel.h"

namespace depthtween {

namespace {

struct Vote {
  float depth, weight;
};

// The depth at which half the weight is reached. Quickselect: partition around a pivot, keep the side that holds the
// half. Reorders the votes, of which there must be one at least.
float MedianOf(std::vector<Vote>& votes) {
  float total = 0, below = 0;
  for (const Vote& vote : votes) total += vote.weight;
  const float half = 0.5F * total;
  auto first = votes.begin(), last = votes.end();
  while (last - first > 1) {
    const float pivot = (first + (last - first) / 2)->depth;
    float less_weight = 0, equal_weight = 0;
    const auto less_end = std::partition(first, last, [&](const Vote& v) { return v.depth < pivot; });
    const auto equal_end = std::partition(less_end, last, [&](const Vote& v) { return v.depth == pivot; });
    for (auto v = first; v != less_end; ++v) less_weight += v->weight;
    for (auto v = less_end; v != equal_end; ++v) equal_weight += v->weight;
    if (below + less_weight > half) {
      last = less_end;
    } else if (below + less_weight + equal_weight >= half || equal_end == last) {
      return pivot;
    } else {
      below += less_weight + equal_weight;
      first = equal_end;
    }
  }
  return first->depth;
}

}  // namespace

Image<float> WeightedMedian(const MedianVoters& own, const std::vector<MedianWitness>& witnesses,
                            ImageView<const uint8_t> mask, const WeightedMedianOptions& options, int threads) {
  const int width = own.depth_m.width(), height = own.depth_m.height();
  const int radius = options.radius;
  // exp(-(difference / sigma)^2 / 2) by sum of absolute channel differences, which exceeds three sigmas where it is
  // cut.
  std::array<float, 766> color_weight;
  for (int i = 0; i < 766; ++i) {
    const float d = static_cast<float>(i) / (3.0F * options.color_sigma);
    color_weight[i] = std::exp(-0.5F * d * d) + 1e-4F;
  }
  // Either window may be the wider one.
  const int widest = std::max(radius, options.witness_radius);
  std::vector<float> space_weight(widest + 1);
  for (int i = 0; i <= widest; ++i) {
    const float d = static_cast<float>(i) / options.space_sigma;
    space_weight[i] = std::exp(-0.5F * d * d);
  }
  // The votes of the window around (cx, cy), by their likeness to `here`.
  const auto gather = [&](const MedianVoters& voters, int cx, int cy, int reach, float scale, Rgb8 here,
                          std::vector<Vote>& votes) {
    for (int y = std::max(0, cy - reach); y <= std::min(height - 1, cy + reach); ++y) {
      const float* depth = voters.depth_m.row(y);
      const float* confidence = voters.confidence.row(y);
      const Rgb8* color = voters.color.row(y);
      const float row_weight = scale * space_weight[std::abs(y - cy)];
      for (int x = std::max(0, cx - reach); x <= std::min(width - 1, cx + reach); ++x) {
        if (depth[x] <= 0 || confidence[x] <= 0) continue;
        const int difference =
            std::abs(color[x].r - here.r) + std::abs(color[x].g - here.g) + std::abs(color[x].b - here.b);
        votes.push_back(
            {depth[x], color_weight[difference] * confidence[x] * row_weight * space_weight[std::abs(x - cx)]});
      }
    }
  };
  Image<float> out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    std::vector<Vote> votes;
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        out(x, y) = own.depth_m(x, y);
        if (mask(x, y) == 0) continue;
        const Rgb8 here = own.color(x, y);
        votes.clear();
        gather(own, x, y, radius, 1.0F, here, votes);
        for (const MedianWitness& witness : witnesses) {
          const Flow2 motion = witness.motion(x, y);
          gather(witness.voters, x + static_cast<int>(std::lround(motion.u)),
                 y + static_cast<int>(std::lround(motion.v)), options.witness_radius, witness.weight, here, votes);
        }
        if (!votes.empty()) out(x, y) = MedianOf(votes);
      }
  });
  return out;
}

}  // namespace depthtween
