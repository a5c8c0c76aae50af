#include "core/render/pull_push.h"

#include <algorithm>
#include <array>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// The mean of the farthest layer among four samples.
LayerSample FarthestLayer(const std::array<LayerSample, 4>& children, float layer_gap) {
  float farthest = 1e30F;
  for (const LayerSample& child : children)
    if (child.weight > 0) farthest = std::min(farthest, child.inverse_depth);
  LayerSample sum;
  for (const LayerSample& child : children) {
    if (child.weight <= 0 || child.inverse_depth * (1 - layer_gap) > farthest) continue;
    sum.r += child.weight * child.r, sum.g += child.weight * child.g, sum.b += child.weight * child.b;
    sum.inverse_depth += child.weight * child.inverse_depth;
    sum.weight += child.weight;
  }
  if (sum.weight <= 0) return {};
  const float scale = 1.0F / sum.weight;
  // A cell with one known pixel speaks with that pixel's full weight.
  return {sum.r * scale, sum.g * scale, sum.b * scale, sum.inverse_depth * scale, std::min(1.0F, sum.weight)};
}

}  // namespace

LayerPyramid::LayerPyramid(ImageView<const Rgb8> color, ImageView<const float> inverse_depth,
                           ImageView<const uint8_t> distrusted, float layer_gap, int threads)
    : layer_gap_(layer_gap) {
  const auto build = [&](int fine_width, int fine_height, const auto& fine) {
    Image<LayerSample> level((fine_width + 1) / 2, (fine_height + 1) / 2);
    ParallelRows(level.height(), threads, [&](int begin, int end) {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < level.width(); ++x) {
          std::array<LayerSample, 4> children;
          for (int k = 0; k < 4; ++k) {
            const int cx = 2 * x + k % 2, cy = 2 * y + k / 2;
            if (cx < fine_width && cy < fine_height) children[k] = fine(cx, cy);
          }
          level(x, y) = FarthestLayer(children, layer_gap);
        }
    });
    levels_.push_back(std::move(level));
  };
  build(color.width(), color.height(), [&](int x, int y) -> LayerSample {
    if (inverse_depth(x, y) <= 0 || distrusted(x, y) != 0) return {};
    const Rgb8 c = color(x, y);
    return {static_cast<float>(c.r), static_cast<float>(c.g), static_cast<float>(c.b), inverse_depth(x, y), 1.0F};
  });
  while (levels_.back().width() > 1 || levels_.back().height() > 1) {
    const Image<LayerSample>& fine = levels_.back();
    const ImageView<const LayerSample> cells = fine.view();  // stays valid when levels_ grows: images own by pointer
    build(fine.width(), fine.height(), [cells](int x, int y) { return cells(x, y); });
  }
}

LayerSample LayerPyramid::Infer(int x, int y, float inverse_depth) const {
  const float nearest = inverse_depth / (1 - layer_gap_);
  LayerSample sample = Gather(x, y, inverse_depth * (1 - 2 * layer_gap_), nearest);
  if (sample.weight <= 0) sample = Gather(x, y, 0.0F, nearest);
  return sample;
}

LayerSample LayerPyramid::Gather(int x, int y, float farthest, float nearest) const {
  LayerSample sum;
  float open = 1.0F;  // what finer levels left undecided
  float scale = 1.0F;
  for (const Image<LayerSample>& level : levels_) {
    scale *= 0.5F;
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
      const float weight = open * share;
      sum.r += weight * cell.r, sum.g += weight * cell.g, sum.b += weight * cell.b;
      sum.inverse_depth += weight * cell.inverse_depth;
      sum.weight += weight;
      decided += share;
    }
    open *= 1 - decided;
    if (open < 0.02F) break;
  }
  if (sum.weight <= 0) return {};
  const float inverse = 1.0F / sum.weight;
  return {sum.r * inverse, sum.g * inverse, sum.b * inverse, sum.inverse_depth * inverse, sum.weight};
}

}  // namespace depthtween
