#include "core/fill/weighted_median.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "core/base/parallel.h"

namespace depthtween {

Image<float> WeightedMedian(ImageView<const float> depth_m, ImageView<const float> confidence,
                            ImageView<const Rgb8> color, ImageView<const uint8_t> mask,
                            const WeightedMedianOptions& options, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  const int radius = options.radius;
  // exp(-(difference / sigma)^2 / 2) by sum of absolute channel differences, which exceeds three sigmas where it is
  // cut.
  std::array<float, 766> color_weight;
  for (int i = 0; i < 766; ++i) {
    const float d = static_cast<float>(i) / (3.0F * options.color_sigma);
    color_weight[i] = std::exp(-0.5F * d * d) + 1e-4F;
  }
  std::vector<float> space_weight(radius + 1);
  for (int i = 0; i <= radius; ++i) {
    const float d = static_cast<float>(i) / options.space_sigma;
    space_weight[i] = std::exp(-0.5F * d * d);
  }
  Image<float> out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    struct Vote {
      float depth, weight;
    };
    std::vector<Vote> votes;
    votes.reserve(static_cast<size_t>((2 * radius + 1) * (2 * radius + 1)));
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        out(x, y) = depth_m(x, y);
        if (mask(x, y) == 0) continue;
        votes.clear();
        float total = 0;
        const Rgb8 here = color(x, y);
        for (int ny = std::max(0, y - radius); ny <= std::min(height - 1, y + radius); ++ny) {
          const float* depth_row = depth_m.row(ny);
          const float* confidence_row = confidence.row(ny);
          const Rgb8* color_row = color.row(ny);
          for (int nx = std::max(0, x - radius); nx <= std::min(width - 1, x + radius); ++nx) {
            if (depth_row[nx] <= 0 || confidence_row[nx] <= 0) continue;
            const Rgb8 c = color_row[nx];
            const int difference = std::abs(c.r - here.r) + std::abs(c.g - here.g) + std::abs(c.b - here.b);
            const float weight = color_weight[difference] * confidence_row[nx] * space_weight[std::abs(nx - x)] *
                                 space_weight[std::abs(ny - y)];
            votes.push_back({depth_row[nx], weight});
            total += weight;
          }
        }
        if (votes.empty()) continue;
        // Quickselect by weight: partition around a pivot, keep the side that holds the half.
        auto first = votes.begin(), last = votes.end();
        float below = 0;
        const float half = 0.5F * total;
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
            first = less_end;
            break;
          } else {
            below += less_weight + equal_weight;
            first = equal_end;
          }
        }
        out(x, y) = first->depth;
      }
  });
  return out;
}

}  // namespace depthtween
