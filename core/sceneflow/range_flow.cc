#include "core/sceneflow/range_flow.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// Both data terms about the present field: a + b du + c dv (- w), by pixel.
struct Linear {
  Image<float> a, du, dv, weight;
  Linear(int width, int height) : a(width, height), du(width, height), dv(width, height), weight(width, height) {}
};

// Slopes of depth at a place, from neighbours on the same surface.
Flow2 DepthSlope(ImageView<const float> depth_m, float x, float y, float here, const DepthNoise& noise) {
  const auto slope = [&](float dx, float dy) {
    const float after = SampleSurface(depth_m, x + dx, y + dy, noise);
    const float before = SampleSurface(depth_m, x - dx, y - dy, noise);
    const bool has_after = SameLayer(after, here, noise), has_before = SameLayer(before, here, noise);
    if (has_after && has_before) return 0.5F * (after - before);
    if (has_after) return after - here;
    if (has_before) return here - before;
    return 0.0F;
  };
  return {slope(1, 0), slope(0, 1)};
}

class Solver {
 public:
  Solver(const PyramidLevel& level, const SurfaceTies& ties, ImageView<const float> trust, const RangeField& reference,
         const DepthNoise& noise, const RangeFlowOptions& options, int threads)
      : level_(level),
        ties_(ties),
        trust_(trust),
        reference_(reference),
        noise_(noise),
        options_(options),
        threads_(threads),
        width_(level.rays->width()),
        height_(level.rays->height()),
        light_(width_, height_),
        range_(width_, height_) {
    for (auto* images : {&across_, &down_})
      for (auto& image : *images) image = Image<float>(width_, height_);
    light_dual_ = Image<float>(width_, height_);
    range_dual_ = Image<float>(width_, height_);
  }

  void Run(RangeField& field) {
    for (int warp = 0; warp < options_.warps; ++warp) {
      Linearise(field);
      // Of the last linearisation: they would push the new one off.
      light_dual_.Fill(0.0F);
      range_dual_.Fill(0.0F);
      Iterate(field);
      field.u = Median3(field.u, threads_);
      field.v = Median3(field.v, threads_);
      field.w = Median3(field.w, threads_);
    }
  }

 private:
  void Linearise(const RangeField& field) {
    const ImageView<const float> from = level_.from.light, to = level_.to.light;
    const ImageView<const float> from_m = level_.from.depth_m, to_m = level_.to.depth_m;
    ParallelRows(height_, threads_, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) {
          const float u = field.u(x, y), v = field.v(x, y);
          const float px = static_cast<float>(x) + u, py = static_cast<float>(y) + v;
          const bool inside = level_.rays->Inside({px, py});
          // Slopes of light are the mean of both frames': steadier than either.
          const float slope_x = 0.25F * (SampleBilinear(to, px + 1, py) - SampleBilinear(to, px - 1, py) +
                                         from.Clamped(x + 1, y) - from.Clamped(x - 1, y));
          const float slope_y = 0.25F * (SampleBilinear(to, px, py + 1) - SampleBilinear(to, px, py - 1) +
                                         from.Clamped(x, y + 1) - from.Clamped(x, y - 1));
          light_.du(x, y) = slope_x;
          light_.dv(x, y) = slope_y;
          light_.a(x, y) = SampleBilinear(to, px, py) - from(x, y) - slope_x * u - slope_y * v;
          light_.weight(x, y) = inside ? options_.light * trust_(x, y) : 0.0F;
          const float z = from_m(x, y), there = SampleSurface(to_m, px, py, noise_);
          const float px_per_m = level_.rays->focal_px() / z;
          const Flow2 slope = DepthSlope(to_m, px, py, there, noise_);
          const float zx = px_per_m * slope.u, zy = px_per_m * slope.v, zt = px_per_m * (there - z);
          range_.du(x, y) = zx;
          range_.dv(x, y) = zy;
          range_.a(x, y) = zt - zx * u - zy * v;
          const float steep = options_.range_falloff * (zx * zx + zy * zy + zt * zt);
          range_.weight(x, y) = inside ? options_.range * trust_(x, y) / (1.0F + steep) : 0.0F;
        }
    });
  }

  void Iterate(RangeField& field) {
    std::array<Image<float>*, 3> now = {&field.u, &field.v, &field.w};
    std::array<const Image<float>*, 3> reference = {&reference_.u, &reference_.v, &reference_.w};
    const std::array<float, 3> smooth = {options_.smooth_flow, options_.smooth_flow, options_.smooth_range};
    std::array<Image<float>, 3> ahead = {field.u.Clone(), field.v.Clone(), field.w.Clone()};
    for (int i = 0; i < options_.iterations; ++i) {
      ParallelRows(
          height_, threads_,
          [&](int first, int last) {
            for (int y = first; y < last; ++y) {
              for (int c = 0; c < 3; ++c) SmoothDuals(ahead[c], *reference[c], smooth[c], c, y);
              DataDuals(ahead, y);
            }
          },
          kBand);
      ParallelRows(
          height_, threads_,
          [&](int first, int last) {
            for (int y = first; y < last; ++y)
              for (int c = 0; c < 3; ++c) Primal(c, y, *now[c], ahead[c]);
          },
          kBand);
    }
  }

  void SmoothDuals(const Image<float>& ahead, const Image<float>& reference, float bound, int c, int y) {
    const int below = std::min(y + 1, height_ - 1);
    const float *a = ahead.row(y), *ab = ahead.row(below), *r = reference.row(y), *rb = reference.row(below);
    const float *tie_right = ties_.right.row(y), *tie_below = ties_.below.row(y);
    float *qx = across_[c].row(y), *qy = down_[c].row(y);
    for (int x = 0; x < width_; ++x) {
      const int right = std::min(x + 1, width_ - 1);  // the tie of the last column is 0
      const float own = a[x] - r[x];
      const float px = qx[x] + 0.5F * tie_right[x] * (a[right] - r[right] - own);
      const float py = qy[x] + 0.5F * tie_below[x] * (ab[x] - rb[x] - own);
      const float shrink = bound / std::max(bound, std::sqrt(px * px + py * py));
      qx[x] = shrink * px;
      qy[x] = shrink * py;
    }
  }

  void DataDuals(const std::array<Image<float>, 3>& ahead, int y) {
    constexpr float kTiny = 1e-3F;
    const float *u = ahead[0].row(y), *v = ahead[1].row(y), *w = ahead[2].row(y);
    float *l = light_dual_.row(y), *r = range_dual_.row(y);
    const auto rows = [y](const Linear& term) {
      return std::array<const float*, 4>{term.a.row(y), term.du.row(y), term.dv.row(y), term.weight.row(y)};
    };
    const auto [la, lu, lv, lw] = rows(light_);
    const auto [ra, ru, rv, rw] = rows(range_);
    for (int x = 0; x < width_; ++x) {
      const float light = la[x] + lu[x] * u[x] + lv[x] * v[x];
      const float range = ra[x] + ru[x] * u[x] + rv[x] * v[x] - w[x];
      l[x] = std::clamp(l[x] + light / (std::abs(lu[x]) + std::abs(lv[x]) + kTiny), -lw[x], lw[x]);
      r[x] = std::clamp(r[x] + range / (std::abs(ru[x]) + std::abs(rv[x]) + 1.0F), -rw[x], rw[x]);
    }
  }

  void Primal(int c, int y, Image<float>& now, Image<float>& ahead) const {
    const float *qx = across_[c].row(y), *qy = down_[c].row(y), *qy_above = down_[c].row(std::max(y - 1, 0));
    const float *tie_right = ties_.right.row(y), *tie_below = ties_.below.row(y),
                *tie_above = ties_.below.row(std::max(y - 1, 0));
    const float above = y > 0 ? 1.0F : 0.0F;
    const float *l = light_dual_.row(y), *r = range_dual_.row(y);
    const float* light = c == 0 ? light_.du.row(y) : light_.dv.row(y);
    const float* range = c == 0 ? range_.du.row(y) : range_.dv.row(y);
    float *value = now.row(y), *next = ahead.row(y);
    for (int x = 0; x < width_; ++x) {
      const float left = x > 0 ? tie_right[x - 1] * qx[x - 1] : 0.0F;
      const float spread = left - tie_right[x] * qx[x] + above * tie_above[x] * qy_above[x] - tie_below[x] * qy[x];
      const float by_light = c < 2 ? light[x] : 0.0F, by_range = c < 2 ? range[x] : -1.0F;
      const float step = 1.0F / (4.0F + std::abs(by_light) + std::abs(by_range));
      const float moved = value[x] - step * (spread + by_light * l[x] + by_range * r[x]);
      next[x] = 2.0F * moved - value[x];
      value[x] = moved;
    }
  }

  static constexpr int kBand = 32;  // rows of a piece of work: pieces of an iteration are short

  const PyramidLevel& level_;
  const SurfaceTies& ties_;
  const ImageView<const float> trust_;
  const RangeField& reference_;
  const DepthNoise noise_;
  const RangeFlowOptions& options_;
  const int threads_, width_, height_;
  Linear light_, range_;
  std::array<Image<float>, 3> across_, down_;  // duals of smoothness
  Image<float> light_dual_, range_dual_;
};

}  // namespace

RangeField ZeroRangeField(int width, int height) {
  return {Image<float>(width, height), Image<float>(width, height), Image<float>(width, height)};
}

void SolveRangeFlow(const PyramidLevel& level, const SurfaceTies& ties, ImageView<const float> trust,
                    const RangeField& reference, const DepthNoise& noise, const RangeFlowOptions& options, int threads,
                    RangeField& field) {
  Solver(level, ties, trust, reference, noise, options, threads).Run(field);
}

absl::StatusOr<RangeField> RangeFlowCoarseToFine(const FramePair& pair, const std::vector<PyramidLevel>& levels,
                                                 int finest) {
  RangeField field;
  for (int i = static_cast<int>(levels.size()) - 1; i >= 0; --i) {
    RETURN_IF_ERROR(pair.StepDone());
    const PyramidLevel& level = levels[i];
    const int width = level.rays->width(), height = level.rays->height();
    if (field.u.empty())
      field = ZeroRangeField(width, height);
    else
      field = {Enlarge(field.u, width, height, 2.0F), Enlarge(field.v, width, height, 2.0F),
               Enlarge(field.w, width, height, 2.0F)};
    if (i < finest) continue;
    SolveRangeFlow(level, TiesAlongSurface(*level.rays, level.from.depth_m), Image<float>(width, height, 1.0F),
                   ZeroRangeField(width, height), pair.noise, {}, pair.threads, field);
  }
  return field;
}

}  // namespace depthtween
