#include "core/render/lens_layers.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/aperture.h"
#include "core/render/linear_light.h"

namespace depthtween {
namespace {

constexpr float kSharpPx = 0.5F;   // up to this radius all light stays in its pixel
constexpr float kApartPx = 1.0F;   // what differs by more in blur is told apart by eye
constexpr float kNothing = 1e-5F;  // below it a weight is rounding

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
  // Two each: what is seen of a layer, and behind it what is hidden, which only fills up where too little is seen.
  int count() const { return 2 * count_; }
  int Of(float radius_px, bool hidden) const {
    int layer = focus_;
    if (std::abs(radius_px) > kSharpPx) {
      const int away = static_cast<int>((std::abs(radius_px) - kSharpPx) / width_px_) + 1;
      layer = std::clamp(radius_px < 0 ? focus_ - away : focus_ + away, 0, count_ - 1);
    }
    return 2 * layer + (hidden ? 1 : 0);
  }

 private:
  float width_px_;
  int focus_, count_;
};

// Light that starts from a pixel.
struct Source {
  Light light;  // what a pixel inside its circle gets
  int32_t row;  // of the aperture
  int16_t x, reach, layer;
};
struct SourceRow {
  std::vector<Source> sources;
  int reach = 0;  // the largest of them
};

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
        aperture_(options.blades, std::max(std::abs(nearest_px_), std::abs(farthest_px_))),
        rows_(height_) {
    ParallelFor(height_, threads, [&](int y) { rows_[y] = Collect(y); });
    for (const SourceRow& row : rows_) reach_ = std::max(reach_, row.reach);
  }

  Image<Rgb8> Render(int threads) const {
    Image<Rgb8> out(width_, height_);
    ParallelRows(height_, threads, [&](int first, int last) {
      // Per pixel all layers side by side, and as differences from the pixel to the left: a row of a circle is two
      // entries however long it is.
      std::vector<Light> steps(static_cast<size_t>(width_ + 2 * Margin()) * layers_.count(), Light{});
      for (int y = first; y < last; ++y) {
        for (int from = std::max(0, y - reach_); from <= std::min(height_ - 1, y + reach_); ++from)
          if (std::abs(y - from) <= rows_[from].reach) Spread(rows_[from].sources, y - from, steps);
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
  int Margin() const { return reach_ + 2; }

  SourceRow Collect(int y) const {
    SourceRow row;
    row.sources.reserve(width_);
    const auto add = [&](int x, Rgb8 color, float radius_px, bool hidden = false) {
      const Aperture::Shape& shape = aperture_.Scaled(radius_px);
      row.sources.push_back({.light = LinearLight::Tables().Decode(color) / shape.area,
                             .row = shape.first_row,
                             .x = static_cast<int16_t>(x),
                             .reach = static_cast<int16_t>(shape.reach),
                             .layer = static_cast<int16_t>(layers_.Of(radius_px, hidden))});
      row.reach = std::max(row.reach, shape.reach);
    };
    for (int x = 0; x < width_; ++x) {
      const float radius_px = radius_px_(x, y);
      const float hidden_m = hidden_.depth_m.empty() ? 0.0F : hidden_.depth_m(x, y);
      const float hidden_px = circle_.RadiusPx(hidden_m);
      if (hidden_m == 0) {
        add(x, view_.color(x, y), radius_px);
      } else if (hidden_px - radius_px > kApartPx) {
        add(x, view_.color(x, y), radius_px);
        add(x, hidden_.color(x, y), hidden_px, true);
      } else {
        // The pixel itself without the foreground that is mixed into it, which must not stay behind as a sharp line
        // when the foreground is spread, nor be spread itself when only the background is.
        add(x, BesideNearer(x, y) ? hidden_.color(x, y) : view_.color(x, y), radius_px);
      }
    }
    return row;
  }

  bool BesideNearer(int x, int y) const {
    for (int j = -1; j <= 1; ++j)
      for (int i = -1; i <= 1; ++i)
        if (radius_px_(x, y) - radius_px_.view().Clamped(x + i, y + j) > kApartPx) return true;
    return false;
  }

  // What the sources of a row give to the row `down` rows below.
  void Spread(const std::vector<Source>& sources, int down, std::vector<Light>& steps) const {
    const int layers = layers_.count();
    for (const Source& source : sources) {
      if (std::abs(down) > source.reach) continue;
      const Aperture::Row& row = aperture_.RowAt(source.row + down);
      Light* const at = steps.data() + (source.x + Margin()) * layers + source.layer;
      const Light begins_late = source.light * row.begin_share, ends_late = source.light * row.end_share;
      at[row.begin_px * layers] += source.light - begins_late;
      at[(row.begin_px + 1) * layers] += begins_late;
      at[row.end_px * layers] -= source.light - ends_late;
      at[(row.end_px + 1) * layers] -= ends_late;
    }
  }

  // Sums up a row's steps, fills each pixel's lens from near to far, and leaves the steps zero.
  void Compose(std::vector<Light>& steps, Rgb8* out) const {
    const int layers = layers_.count();
    std::vector<Light> sums(layers, Light{});
    Light* step = steps.data();
    for (int x = -Margin(); x < width_ + Margin(); ++x, step += layers) {
      for (int k = 0; k < layers; ++k) {
        sums[k] += step[k];
        step[k] = Light{};
      }
      if (x < 0 || x >= width_) continue;
      Light filled = {};
      for (int k = 0; k < layers && filled[3] < 1 - kNothing; ++k) {
        const float weight = sums[k][3];
        if (weight > kNothing) filled += sums[k] * (std::min(weight, 1 - filled[3]) / weight);
      }
      // Beyond the picture's border nothing is known, so a lens may stay partly empty: what fills it stands for all.
      out[x] = LinearLight::Tables().Encode(filled / std::max(filled[3], kNothing));
    }
  }

  const RenderView view_;
  const HiddenBackground& hidden_;
  const CircleOfConfusion circle_;
  const int width_, height_;
  const Image<float> radius_px_;
  const float nearest_px_, farthest_px_;
  const Layering layers_;
  const Aperture aperture_;
  std::vector<SourceRow> rows_;
  int reach_ = 0;
};

}  // namespace

Image<Rgb8> BlurInLayers(const RenderView& view, const HiddenBackground& hidden, const CircleOfConfusion& circle,
                         const LensLayersOptions& options, int threads) {
  return LayeredBlur(view, hidden, circle, options, threads).Render(threads);
}

}  // namespace depthtween
