#include "core/upsample/uncertainty.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/parallel.h"
#include "core/upsample/choose.h"

namespace depthtween {
namespace {

constexpr int kJumpReach = 2;  // pixels from a silhouette where its wrong side is a danger
// Neighbours whose answers are compared: those in the 3 x 3 cells of so many pixels around one, one in so many each
// way.
constexpr int kCell = 10, kStride = 2;
constexpr float kNoiseLeft = 0.12F;  // of the noise of a measurement: keys are denoised, and two of them fused

float Square(float value) { return value * value; }

// Whether what the keys say of a pixel whose depth is `z` is said of one surface.
bool OfOneSurface(const Fused& fused, int x, int y, float z) {
  return std::abs(fused.change_m(x, y)) <= kOneSurface * z || fused.travelled(x, y) != 0;
}

// How the keys' answers about one surface change around each pixel, from the first key to the second: their mean, and
// how far single pixels are from it. Where no neighbour tells, noise is what one expects.
class LocalChanges {
 public:
  struct Row {
    std::vector<float> mean_m, deviation_m;  // a value a pixel
  };

  // Pixels near jumps, which may be of the wrong side, do not count.
  LocalChanges(ImageView<const float> depth_m, const Fused& fused, ImageView<const uint8_t> near_jump,
               const DepthNoise& noise, int threads)
      : width_(depth_m.width()),
        across_((depth_m.width() + kCell - 1) / kCell),
        down_((depth_m.height() + kCell - 1) / kCell),
        mean_m_(across_, down_),
        deviation_m_(across_, down_) {
    for (int x = 0; x < width_; ++x) places_.push_back(Between(x, across_));
    const auto in_cell = [&](const Image<float>& of_cells, int x, int y) { return of_cells(x / kCell, y / kCell); };
    Image<float> sum(across_, down_), count(across_, down_);
    ForAnswers(depth_m, fused, near_jump, threads, [&](int x, int y, float change, float) {
      sum(x / kCell, y / kCell) += change, ++count(x / kCell, y / kCell);
    });
    sum = Around(sum), count = Around(count);
    for (size_t i = 0; i < sum.pixel_count(); ++i)
      if (count.data()[i] > 0) mean_m_.data()[i] = sum.data()[i] / count.data()[i];
    Image<float> squares(across_, down_);
    ForAnswers(depth_m, fused, near_jump, threads, [&](int x, int y, float change, float z) {
      // Deviations wider than a layer are of another surface, and count as much as the widest.
      const float deviation = std::min(std::abs(change - in_cell(mean_m_, x, y)), WidestGap(z, noise));
      squares(x / kCell, y / kCell) += deviation * deviation;
    });
    squares = Around(squares);
    for (int row = 0; row < down_; ++row)
      for (int column = 0; column < across_; ++column) {
        const float here = depth_m(std::min(width_ - 1, column * kCell + kCell / 2),
                                   std::min(depth_m.height() - 1, row * kCell + kCell / 2));
        deviation_m_(column, row) =
            count(column, row) > 0 ? std::sqrt(squares(column, row) / count(column, row)) : noise.At(here);
      }
  }

  // Linear between the middles of cells, so that no cell is to be seen.
  void ReadRow(int y, Row& row) const {
    row.mean_m.resize(width_), row.deviation_m.resize(width_);
    const Place down = Between(y, down_);
    std::vector<float> cells(across_);
    const auto read = [&](const Image<float>& from, std::vector<float>& to) {
      const auto mix = [](float first, float second, float share) { return first + share * (second - first); };
      for (int column = 0; column < across_; ++column)
        cells[column] = mix(from(column, down.first), from(column, down.second), down.share);
      for (int x = 0; x < width_; ++x) to[x] = mix(cells[places_[x].first], cells[places_[x].second], places_[x].share);
    };
    read(mean_m_, row.mean_m), read(deviation_m_, row.deviation_m);
  }

 private:
  // The cells whose middles lie on both sides of a pixel, and how far it is on the way from one to the other, 0..1.
  struct Place {
    int first, second;
    float share;
  };
  static Place Between(int pixel, int cells) {
    const float at = std::max(0.0F, (static_cast<float>(pixel) + 0.5F) / kCell - 0.5F);
    const int first = static_cast<int>(at);
    return {first, std::min(first + 1, cells - 1), at - static_cast<float>(first)};
  }

  // Calls body(x, y, change, depth) where both keys speak of one surface; a row of cells is one item.
  template <typename Body>
  void ForAnswers(ImageView<const float> depth_m, const Fused& fused, ImageView<const uint8_t> near_jump, int threads,
                  const Body& body) const {
    ParallelRows(
        depth_m.height(), threads,
        [&](int begin, int end) {
          for (int y = begin; y < end; y += kStride)
            for (int x = 0; x < width_; x += kStride) {
              const float z = depth_m(x, y), change = fused.change_m(x, y);
              if (z > 0 && change != 0 && !near_jump(x, y) && OfOneSurface(fused, x, y, z)) body(x, y, change, z);
            }
        },
        /*band=*/kCell);
  }

  // Each cell with its neighbours.
  Image<float> Around(const Image<float>& cells) const {
    Image<float> around(across_, down_);
    for (int row = 0; row < down_; ++row)
      for (int column = 0; column < across_; ++column)
        for (int r = std::max(0, row - 1); r <= std::min(down_ - 1, row + 1); ++r)
          for (int c = std::max(0, column - 1); c <= std::min(across_ - 1, column + 1); ++c)
            around(column, row) += cells(c, r);
    return around;
  }

  int width_, across_, down_;
  std::vector<Place> places_;          // of columns of pixels
  Image<float> mean_m_, deviation_m_;  // of cells
};

}  // namespace

Image<float> PredictSigma(ImageView<const float> depth_m, const Fused& fused, const DepthNoise& noise,
                          const SigmaWeights& weights, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  Image<float> sigma(width, height);
  const Image<uint8_t> near_jump = NearDepthJumps(depth_m, kJumpReach, noise, threads);
  const LocalChanges around(depth_m, fused, near_jump, noise, threads);
  ParallelRows(height, threads, [&](int begin, int end) {
    // Of each column, the nearest and the farthest depth within kJumpReach rows; +inf and 0 where all are unknown.
    std::vector<float> nearest(width), farthest(width);
    LocalChanges::Row local;
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
      around.ReadRow(y, local);
      const float *const depths = depth_m.row(y), *const changes = fused.change_m.row(y);
      for (int x = 0; x < width; ++x) {
        const float z = depths[x];
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
        const float wrong_side = (weights.step + weights.step_per_cost * mismatch) * step;
        const float change = changes[x];
        const bool one_surface = OfOneSurface(fused, x, y, z);
        const float disagreement = change == 0   ? 0
                                   : one_surface ? weights.one_surface * (change - local.mean_m[x])
                                                 : (step > 0 ? weights.two_surfaces : weights.hidden_once) * change;
        const float unrest = (weights.unrest + weights.unrest_per_cost * mismatch) * local.deviation_m[x];
        const Provenance seen = fused.provenance(x, y);
        const float unseen = seen == Provenance::kInferred ? weights.inferred
                             : seen == Provenance::kOne    ? weights.seen_once
                                                           : 0;
        const float share = weights.share_per_cost * mismatch;
        const float variance = Square(kNoiseLeft * noise.At(z)) + Square(unrest) + Square(disagreement) +
                               Square(wrong_side) + (Square(unseen) + Square(share)) * Square(z);
        sigma(x, y) = std::sqrt(variance);
      }
    }
  });
  return sigma;
}

}  // namespace depthtween
