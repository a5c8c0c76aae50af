#include "core/render/pull_push.h"

#include <algorithm>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// Adds a sample to a sum of weighted ones, and divides in the end.
void Accumulate(const LayerSample& sample, float weight, LayerSample& sum) {
  for (int k = 0; k < 3; ++k) sum.value[k] += weight * sample.value[k];
  sum.inverse_depth += weight * sample.inverse_depth;
  sum.weight += weight;
}
LayerSample Mean(LayerSample sum) {
  if (sum.weight <= 0) return {};
  const float scale = 1.0F / sum.weight;
  for (float& value : sum.value) value *= scale;
  sum.inverse_depth *= scale;
  return sum;
}

// The mean of the farthest layer among four samples.
LayerSample FarthestLayer(const std::array<LayerSample, 4>& children, float layer_gap) {
  float farthest = 1e30F;
  for (const LayerSample& child : children)
    if (child.weight > 0) farthest = std::min(farthest, child.inverse_depth);
  LayerSample sum;
  for (const LayerSample& child : children)
    if (child.weight > 0 && child.inverse_depth * (1 - layer_gap) <= farthest) Accumulate(child, child.weight, sum);
  sum = Mean(sum);
  sum.weight = std::min(1.0F, sum.weight);  // one known pixel lets a cell speak with full weight
  return sum;
}

}  // namespace

LayerPyramid::LayerPyramid(ImageView<const Rgb8> color, ImageView<const float> inverse_depth,
                           ImageView<const uint8_t> distrusted, float layer_gap, int threads)
    : layer_gap_(layer_gap) {
  const auto read = [&](int x, int y) -> LayerSample {
    if (inverse_depth(x, y) <= 0 || distrusted(x, y) != 0) return {};
    const Rgb8 c = color(x, y);
    return {{static_cast<float>(c.r), static_cast<float>(c.g), static_cast<float>(c.b)}, inverse_depth(x, y), 1.0F};
  };
  Build(color.width(), color.height(), read, threads);
}

LayerPyramid::LayerPyramid(ImageView<const Flow2> motion, ImageView<const float> inverse_depth,
                           ImageView<const uint8_t> distrusted, float layer_gap, int threads)
    : layer_gap_(layer_gap) {
  const auto read = [&](int x, int y) -> LayerSample {
    if (inverse_depth(x, y) <= 0 || distrusted(x, y) != 0) return {};
    return {{motion(x, y).u, motion(x, y).v, 0.0F}, inverse_depth(x, y), 1.0F};
  };
  Build(motion.width(), motion.height(), read, threads);
}

template <typename Read>
void LayerPyramid::Build(int width, int height, const Read& read, int threads) {
  const auto add_level = [&](int fine_width, int fine_height, const auto& fine) {
    Image<LayerSample> level((fine_width + 1) / 2, (fine_height + 1) / 2);
    ParallelRows(level.height(), threads, [&](int begin, int end) {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < level.width(); ++x) {
          std::array<LayerSample, 4> children;
          for (int k = 0; k < 4; ++k) {
            const int cx = 2 * x + k % 2, cy = 2 * y + k / 2;
            if (cx < fine_width && cy < fine_height) children[k] = fine(cx, cy);
          }
          level(x, y) = FarthestLayer(children, layer_gap_);
        }
    });
    levels_.push_back(std::move(level));
  };
  add_level(width, height, read);
  while (levels_.back().width() > 1 || levels_.back().height() > 1) {
    const ImageView<const LayerSample> fine = levels_.back();  // its pixels stay where they are when levels_ grows
    add_level(fine.width(), fine.height(), fine);
  }
}

LayerSample LayerPyramid::Infer(int x, int y, float inverse_depth, int finest) const {
  const float nearest = inverse_depth / (1 - layer_gap_);
  const LayerSample sample = Gather(x, y, inverse_depth * (1 - 2 * layer_gap_), nearest, finest);
  return sample.weight > 0 ? sample : Gather(x, y, 0.0F, nearest, finest);
}

LayerSample LayerPyramid::Gather(int x, int y, float farthest, float nearest, int finest) const {
  LayerSample sum;
  float open = 1.0F;  // what finer levels left undecided
  for (size_t l = std::min<size_t>(finest, levels_.size() - 1); l < levels_.size() && open > 0.02F; ++l) {
    const Image<LayerSample>& level = levels_[l];
    const float scale = 1.0F / static_cast<float>(2 << l);
    const float fx = (static_cast<float>(x) + 0.5F) * scale - 0.5F, fy = (static_cast<float>(y) + 0.5F) * scale - 0.5F;
    const int x0 = static_cast<int>(fx + 1) - 1, y0 = static_cast<int>(fy + 1) - 1;
    const float ax = fx - static_cast<float>(x0), ay = fy - static_cast<float>(y0);
    float decided = 0;
    for (int k = 0; k < 4; ++k) {
      const int cx = x0 + k % 2, cy = y0 + k / 2;
      if (!level.Contains(cx, cy)) continue;
      const LayerSample& cell = level(cx, cy);
      if (cell.weight <= 0 || cell.inverse_depth < farthest || cell.inverse_depth > nearest) continue;
      const float share = (k % 2 == 0 ? 1 - ax : ax) * (k / 2 == 0 ? 1 - ay : ay) * cell.weight;
      Accumulate(cell, open * share, sum);
      decided += share;
    }
    open *= 1 - decided;
  }
  return Mean(sum);
}

}  // namespace depthtween
