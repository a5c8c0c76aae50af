#include "core/fill/weighted_median.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "core/base/lanes.h"
#include "core/base/parallel.h"

namespace depthtween {

namespace {

// Depths and weights of a window's votes, side by side, with room for whole lanes.
class Votes {
 public:
  explicit Votes(size_t most) : depth_(most + kLanes), weight_(most + kLanes) {}
  void Clear() { count_ = 0; }
  bool empty() const { return count_ == 0; }
  void Add(float depth, float weight) {
    depth_[count_] = depth;
    weight_[count_] = weight;
    ++count_;
  }

  // The depth at which half the weight is reached. Halves the range of depths that holds it: to try a depth is one pass
  // over all votes without a branch, and about eight are needed. There must be one vote at least.
  float Median() {
    // What fills the last lanes is one of the votes, without weight.
    std::fill_n(depth_.begin() + count_, kLanes, depth_[0]);
    std::fill_n(weight_.begin() + count_, kLanes, 0.0F);
    Lanes total = {}, least = LoadLanes(depth_.data()), most = least;
    for (int i = 0; i < count_; i += kLanes) {
      const Lanes depth = LoadLanes(depth_.data() + i);
      total += LoadLanes(weight_.data() + i);
      least = MinLanes(least, depth), most = MaxLanes(most, depth);
    }
    const float half = 0.5F * SumLanes(total);
    float low = LeastOf(least), high = MostOf(most);
    while (low < high) {
      float middle = low + 0.5F * (high - low);
      if (middle >= high) middle = low;  // there is no number between them
      Lanes below = {}, next_high = AllLanes(low), next_low = AllLanes(high);
      for (int i = 0; i < count_; i += kLanes) {
        const Lanes depth = LoadLanes(depth_.data() + i);
        const LaneInts is_below = depth <= middle;
        below += KeepLanes(is_below, LoadLanes(weight_.data() + i));
        next_high = MaxLanes(next_high, is_below ? depth : AllLanes(low));
        next_low = MinLanes(next_low, is_below ? AllLanes(high) : depth);
      }
      if (SumLanes(below) >= half)
        high = MostOf(next_high);
      else
        low = LeastOf(next_low);
    }
    return low;
  }

 private:
  static float LeastOf(Lanes v) {
    float least = v[0];
    for (int i = 1; i < kLanes; ++i) least = std::min(least, v[i]);
    return least;
  }
  static float MostOf(Lanes v) {
    float most = v[0];
    for (int i = 1; i < kLanes; ++i) most = std::max(most, v[i]);
    return most;
  }

  std::vector<float> depth_, weight_;
  int count_ = 0;
};

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
  const auto gather = [&](const MedianVoters& voters, int cx, int cy, int reach, float scale, Rgb8 here, Votes& votes) {
    for (int y = std::max(0, cy - reach); y <= std::min(height - 1, cy + reach); ++y) {
      const float* depth = voters.depth_m.row(y);
      const float* confidence = voters.confidence.row(y);
      const Rgb8* color = voters.color.row(y);
      const float row_weight = scale * space_weight[std::abs(y - cy)];
      for (int x = std::max(0, cx - reach); x <= std::min(width - 1, cx + reach); ++x) {
        if (depth[x] <= 0 || confidence[x] <= 0) continue;
        const int difference =
            std::abs(color[x].r - here.r) + std::abs(color[x].g - here.g) + std::abs(color[x].b - here.b);
        votes.Add(depth[x], color_weight[difference] * confidence[x] * row_weight * space_weight[std::abs(x - cx)]);
      }
    }
  };
  const auto window_size = [](int reach) { return static_cast<size_t>((2 * reach + 1) * (2 * reach + 1)); };
  const size_t most_votes = window_size(radius) + witnesses.size() * window_size(options.witness_radius);
  Image<float> out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    Votes votes(most_votes);
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        out(x, y) = own.depth_m(x, y);
        if (mask(x, y) == 0) continue;
        const Rgb8 here = own.color(x, y);
        votes.Clear();
        gather(own, x, y, radius, 1.0F, here, votes);
        for (const MedianWitness& witness : witnesses) {
          const Flow2 motion = witness.motion(x, y);
          gather(witness.voters, x + static_cast<int>(std::lround(motion.u)),
                 y + static_cast<int>(std::lround(motion.v)), options.witness_radius, witness.weight, here, votes);
        }
        if (!votes.empty()) out(x, y) = votes.Median();
      }
  });
  return out;
}

}  // namespace depthtween
