#include "core/render/lens_layers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/aperture.h"

namespace depthtween {
namespace {

constexpr float kSharpPx = 0.5F;    // up to this radius all light stays in its pixel
constexpr float kApartPx = 1.0F;    // what differs by more in blur is told apart by eye
constexpr float kOpeningPx = 1.5F;  // beyond its own circle a silhouette opens the view to what it hides
constexpr float kAlike = 0.02F;     // colours nearer to each other than this cannot be taken apart
constexpr float kNothing = 1e-5F;   // below it a weight is rounding

// Inferred pixels count less than what is seen of the same layer around it, and the less the farther that spreads:
// up to 1.5 dB closer to a real lens at edges than full trust, and nearly as good within a factor of 3 either way.
float TrustInInferred(float radius_px) { return 0.3F / (1 + 0.25F * std::abs(radius_px)); }

// What lies beyond the picture's border is taken to look like what lies within.
int Mirrored(int i, int count) { return std::clamp(i < 0 ? -1 - i : i >= count ? 2 * count - 1 - i : i, 0, count - 1); }

// Cuts the range of radii into layers, numbered from near to far.
class Layering {
 public:
  Layering(float nearest_px, float farthest_px, int layers) {
    const float before = std::max(0.0F, -nearest_px - kSharpPx), behind = std::max(0.0F, farthest_px - kSharpPx);
    // One layer is the focus, and each side may end within a layer.
    width_px_ = std::max((before + behind) / static_cast<float>(layers - 3), 1e-3F);
    focus_ = static_cast<int>(std::ceil(before / width_px_));
    count_ = focus_ + 1 + static_cast<int>(std::ceil(behind / width_px_));
  }
  // Two each: what is seen of it, 2 k, and behind that what is hidden, 2 k + 1, which fills up where too little is
  // seen.
  int count() const { return 2 * count_; }
  int Of(float radius_px) const {
    if (std::abs(radius_px) <= kSharpPx) return 2 * focus_;
    const int away = static_cast<int>((std::abs(radius_px) - kSharpPx) / width_px_) + 1;
    return 2 * std::clamp(radius_px < 0 ? focus_ - away : focus_ + away, 0, count_ - 1);
  }

 private:
  float width_px_;
  int focus_, count_;
};

// A pixel at a silhouette, of which the nearer surface covers a part. Left whole, it would stay behind as a sharp line
// when the foreground is spread, or carry foreground into the background when that is.
struct Mixture {
  Light foreground;  // weight 0..1: its share
  Light background;  // weight 1
};

// The foreground's share is where `mixed` lies on the way from `background` to `foreground`, if it can be told. As long
// as background is the larger part, what is left of it keeps its own texture.
Mixture TakeApart(Light mixed, Light foreground, Light background) {
  const auto dot = [](Light a, Light b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
  const Light way = foreground - background;
  if (dot(way, way) < kAlike * kAlike) return {Light{}, mixed};
  const float share = std::clamp(dot(way, mixed - background) / dot(way, way), 0.0F, 1.0F);
  if (share > 0.5F) return {share * foreground, background};
  const Light left = (mixed - share * foreground) / (1 - share);
  return {share * foreground, left > 0 ? left : Light{}};
}

// Pixels side by side whose light spreads alike: over the same shape, in the same layer.
struct Run {
  int32_t x, count;
  int32_t first_light;
  int32_t row;  // of the aperture
  int16_t reach, layer;
};

// Light that starts from a row of pixels.
struct SourceRow {
  std::vector<Light> lights;  // what each pixel inside a circle gets
  std::vector<Run> runs;
  int reach = 0;  // the largest of them

  void Add(int x, Light light, const Aperture::Shape& shape, int layer) {
    if (runs.empty() || runs.back().x + runs.back().count != x || runs.back().row != shape.first_row ||
        runs.back().layer != layer)
      runs.push_back({.x = x,
                      .count = 0,
                      .first_light = static_cast<int32_t>(lights.size()),
                      .row = shape.first_row,
                      .reach = static_cast<int16_t>(shape.reach),
                      .layer = static_cast<int16_t>(layer)});
    ++runs.back().count;
    lights.push_back(light);
    reach = std::max(reach, shape.reach);
  }
};

// Apart, so that runs are long.
enum Kind { kSeen, kHidden, kMixedIn, kOpening, kKinds };
using SourceRows = std::array<SourceRow, kKinds>;

class LayeredBlur {
 public:
  LayeredBlur(const RenderView& view, const HiddenBackground& hidden, const CircleOfConfusion& circle,
              const LensLayersOptions& options, int threads)
      : view_(view),
        hidden_(hidden),
        circle_(circle),
        width_(view.color.width()),
        height_(view.color.height()),
        radius_px_(Radii(view.depth_m, circle)),
        nearest_px_(*std::min_element(radius_px_.data(), radius_px_.data() + radius_px_.pixel_count())),
        // What lies hidden may be farther than all that is seen, but not farther than infinity.
        farthest_px_(circle.RadiusPx(0)),
        layers_(nearest_px_, farthest_px_, options.layers),
        aperture_(options.blades, std::max(std::abs(nearest_px_), std::abs(farthest_px_)) + kOpeningPx),
        rows_(height_) {
    ParallelFor(height_, threads, [&](int y) { rows_[y] = Collect(y); });
    for (const SourceRows& rows : rows_)
      for (const SourceRow& row : rows) reach_ = std::max(reach_, row.reach);
  }

  Image<Light> Render(int threads) const {
    Image<Light> out(width_, height_);
    ParallelRows(height_, threads, [&](int first, int last) {
      // A row of each layer, as differences from the pixel to the left: a row of a circle is its rims, however wide.
      std::vector<Light> steps(static_cast<size_t>(Stride()) * (Openings() + 1), Light{});
      for (int y = first; y < last; ++y) {
        for (int down = -reach_; down <= reach_; ++down) {
          for (const SourceRow& from : rows_[Mirrored(y - down, height_)])
            if (std::abs(down) <= from.reach) Spread(from, down, steps);
        }
        Compose(steps, out.row(y));
      }
    });
    return out;
  }

 private:
  static Image<float> Radii(ImageView<const float> depth_m, const CircleOfConfusion& circle) {
    Image<float> radius_px(depth_m.width(), depth_m.height());
    for (int y = 0; y < depth_m.height(); ++y)
      for (int x = 0; x < depth_m.width(); ++x) radius_px(x, y) = circle.RadiusPx(depth_m(x, y));
    return radius_px;
  }
  int Margin() const { return 2 * reach_ + 2; }     // the outermost source, and from there its circle
  int Openings() const { return layers_.count(); }  // the layer of weight alone that tells where silhouettes are near
  int Stride() const { return width_ + 2 * Margin(); }

  SourceRows Collect(int y) const {
    SourceRows rows;
    rows[kSeen].lights.reserve(width_);
    const auto add = [&](Kind kind, int x, Light light, float radius_px, int layer) {
      const Aperture::Shape& shape = aperture_.Scaled(radius_px);
      if (x < -shape.reach || x >= width_ + shape.reach) return;
      rows[kind].Add(x, kind == kOpening ? light : light / shape.area, shape, layer);
    };
    const LinearLight& tables = LinearLight::Tables();
    const int outside = static_cast<int>(circle_.limit_px) + 2;
    for (int x = -outside; x < width_ + outside; ++x) {
      const int from = Mirrored(x, width_);
      const float radius_px = radius_px_(from, y);
      Light seen = tables.Decode(view_.color(from, y));
      if (!hidden_.depth_m.empty() && hidden_.depth_m(from, y) > 0) {
        const float hidden_px = circle_.RadiusPx(hidden_.depth_m(from, y));
        const Light hidden = tables.Decode(hidden_.color(from, y));
        const Beside beside = LookBeside(from, y);
        if (hidden_px - radius_px > kApartPx) {
          const bool known = hidden_.source(from, y) == kHiddenSeen;
          add(kHidden, x, hidden * (known ? 1.0F : TrustInInferred(hidden_px)), hidden_px, layers_.Of(hidden_px) + 1);
          const bool at_silhouette = 2 * beside.farthest_px > radius_px + hidden_px;  // of what hides it, not within
          if (at_silhouette)
            add(kOpening, x, Light{0, 0, 0, 1}, std::copysign(std::abs(radius_px) + kOpeningPx, radius_px), Openings());
        } else if (radius_px - beside.nearest_px > kApartPx) {
          const Mixture mixture = TakeApart(seen, tables.Decode(beside.nearest), hidden);
          if (mixture.foreground[3] > 0)
            add(kMixedIn, x, mixture.foreground, beside.nearest_px, layers_.Of(beside.nearest_px));
          seen = mixture.background;
        }
      }
      add(kSeen, x, seen, radius_px, layers_.Of(radius_px));
    }
    return rows;
  }

  // The surfaces at and around a pixel.
  struct Beside {
    Rgb8 nearest;
    float nearest_px, farthest_px;
  };
  Beside LookBeside(int x, int y) const {
    Beside beside{view_.color(x, y), radius_px_(x, y), radius_px_(x, y)};
    for (int v = std::max(0, y - 1); v <= std::min(height_ - 1, y + 1); ++v)
      for (int u = std::max(0, x - 1); u <= std::min(width_ - 1, x + 1); ++u) {
        const float radius_px = radius_px_(u, v);
        if (radius_px < beside.nearest_px) beside.nearest = view_.color(u, v), beside.nearest_px = radius_px;
        beside.farthest_px = std::max(beside.farthest_px, radius_px);
      }
    return beside;
  }

  // What a row of sources gives to the row `down` rows below.
  void Spread(const SourceRow& from, int down, std::vector<Light>& steps) const {
    for (const Run& run : from.runs) {
      if (std::abs(down) > run.reach) continue;
      const Light* const lights = from.lights.data() + run.first_light;
      Light* const at = steps.data() + run.layer * Stride() + Margin() + run.x;
      for (const auto& [px, change] : aperture_.RowAt(run.row + down))
        for (int i = 0; i < run.count; ++i) at[px + i] += lights[i] * change;
    }
  }

  // Sums up a row's steps, fills each pixel's lens from near to far, and leaves the steps zero.
  void Compose(std::vector<Light>& steps, Light* out) const {
    std::vector<Light> sums(Openings() + 1, Light{});
    for (int x = -Margin(); x < width_ + Margin(); ++x) {
      Light* step = steps.data() + Margin() + x;
      for (Light& sum : sums) {
        sum += *step;
        *step = Light{};
        step += Stride();
      }
      if (x < 0 || x >= width_) continue;
      const float open = std::min(1.0F, sums[Openings()][3]);
      out[x] = Light{};
      if (open < 1 - kNothing) out[x] += (1 - open) * Closed(sums);
      if (open > kNothing) out[x] += open * Open(sums);
      out[x] /= out[x][3];
    }
  }

  // Away from silhouettes what is seen is all there is: small steps of depth may leave gaps, but nothing shows in them.
  Light Closed(const std::vector<Light>& sums) const {
    const Light filled = Fill(sums, 0, Openings(), 2, 1.0F);
    return filled / filled[3];
  }

  // Where a lens sees past a silhouette, what is hidden fills up. From its layer on, all that is left of the lens sees
  // what is there.
  Light Open(const std::vector<Light>& sums) const {
    int hidden = 1;
    while (hidden < Openings() && sums[hidden][3] <= kNothing) hidden += 2;
    const Light before = Fill(sums, 0, hidden - 1, 1, 1.0F);
    const Light behind = Fill(sums, hidden - 1, Openings(), 1, 1 - before[3]);
    const Light filled = behind[3] > kNothing ? before + behind * ((1 - before[3]) / behind[3]) : before;
    return filled / filled[3];
  }

  // What every `stride`-th of the layers [first, last) shows of itself in the share `room` of the lens, near to far.
  static Light Fill(const std::vector<Light>& layers, int first, int last, int stride, float room) {
    Light filled = {};
    for (int k = first; k < last && filled[3] < room - kNothing; k += stride) {
      const float weight = layers[k][3];
      if (weight > kNothing) filled += layers[k] * (std::min(weight, room - filled[3]) / weight);
    }
    return filled;
  }

  const RenderView view_;
  const HiddenBackground& hidden_;
  const CircleOfConfusion circle_;
  const int width_, height_;
  const Image<float> radius_px_;
  const float nearest_px_, farthest_px_;
  const Layering layers_;
  const Aperture aperture_;
  std::vector<SourceRows> rows_;
  int reach_ = 0;
};

}  // namespace

Image<Light> BlurInLayers(const RenderView& view, const HiddenBackground& hidden, const CircleOfConfusion& circle,
                          const LensLayersOptions& options, int threads) {
  return LayeredBlur(view, hidden, circle, options, threads).Render(threads);
}

}  // namespace depthtween
