#include "core/render/stereo.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"

namespace depthtween {
namespace {

constexpr double kMaxDisparityShare = 0.2;  // of the width: beyond it nobody fuses the eyes and holes eat the picture

// Colour that is added to (1 - alpha) of what lies behind it. sRGB, 0..255.
struct Premultiplied {
  float r = 0, g = 0, b = 0, alpha = 0;
};

Premultiplied Lerp(const Premultiplied& a, const Premultiplied& b, float t) {
  return {a.r + t * (b.r - a.r), a.g + t * (b.g - a.g), a.b + t * (b.b - a.b), a.alpha + t * (b.alpha - a.alpha)};
}

// `mixed` without the share 1 - alpha of `behind`.
Premultiplied TakeOut(Rgb8 mixed, Rgb8 behind, float alpha) {
  return {static_cast<float>(mixed.r) - (1 - alpha) * static_cast<float>(behind.r),
          static_cast<float>(mixed.g) - (1 - alpha) * static_cast<float>(behind.g),
          static_cast<float>(mixed.b) - (1 - alpha) * static_cast<float>(behind.b), alpha};
}

uint8_t ToByte(float v) { return static_cast<uint8_t>(std::clamp(v + 0.5F, 0.0F, 255.0F)); }

Rgb8 LerpColor(Rgb8 a, Rgb8 b, float t) {
  const auto mix = [t](uint8_t u, uint8_t v) { return ToByte(static_cast<float>(u) + t * static_cast<float>(v - u)); };
  return {mix(a.r, b.r), mix(a.g, b.g), mix(a.b, b.b)};
}

// The share of foreground in a pixel that may be a mixture: its place between the two colours. Colours too alike to
// tell say `if_alike`.
float ForegroundShare(Rgb8 mixed, Rgb8 foreground, Rgb8 background, float if_alike) {
  const int r = foreground.r - background.r, g = foreground.g - background.g, b = foreground.b - background.b;
  const int length2 = r * r + g * g + b * b;
  constexpr int kTellApart = 3 * 12 * 12;
  if (length2 < kTellApart) return if_alike;
  const int along = r * (mixed.r - background.r) + g * (mixed.g - background.g) + b * (mixed.b - background.b);
  return std::clamp(static_cast<float>(along) / static_cast<float>(length2), 0.0F, 1.0F);
}

// Background with the share `alpha` of foreground taken out of a mixture, for alpha < 1/2.
Rgb8 Unmix(Rgb8 mixed, Rgb8 foreground, float alpha) {
  const auto channel = [alpha](uint8_t m, uint8_t f) {
    return ToByte((static_cast<float>(m) - alpha * static_cast<float>(f)) / (1 - alpha));
  };
  return {channel(mixed.r, foreground.r), channel(mixed.g, foreground.g), channel(mixed.b, foreground.b)};
}

// One surface along a row of the view: what stands at each of its pixels.
struct RowLayer {
  std::vector<float> inverse_depth;  // 0 = nothing
  std::vector<float> alpha;
  std::vector<Rgb8> color;
  explicit RowLayer(int width) : inverse_depth(width), alpha(width), color(width) {}
};

// Renders row by row: every target row depends on its source row and the two above and below.
class EyeRenderer {
 public:
  EyeRenderer(const RenderView& view, const HiddenBackground& hidden, const StereoGeometry& geometry, double offset)
      : view_(view),
        hidden_(hidden),
        width_(view.color.width()),
        same_layer_(1 - geometry.background.layer_gap),
        shift_(static_cast<float>(-offset * geometry.focal_px * geometry.baseline_m)),
        inverse_convergence_(static_cast<float>(1 / geometry.convergence_m)),
        front_(width_),
        fringe_(width_),
        behind_(width_),
        opaque_(width_),
        soft_depth_(width_),
        soft_(width_) {}

  void Render(int y, Rgb8* out, uint8_t* missing) {
    ReadRow(y);
    std::fill(opaque_.begin(), opaque_.end(), Sample{});
    std::fill(soft_depth_.begin(), soft_depth_.end(), 0.0F);
    DrawFront(y);
    DrawFringe(y);
    if (missing != nullptr)
      for (int t = 0; t < width_; ++t)
        missing[t] = opaque_[t].layer == nullptr && !(soft_depth_[t] > 0 && soft_[t].alpha >= 0.5F);
    DrawBehind();
    FillGaps();
    for (int t = 0; t < width_; ++t) out[t] = Compose(t);
  }

 private:
  struct Sample {
    float inverse_depth = 0;
    float x = 0;  // place in the source row
    const RowLayer* layer = nullptr;
  };

  float Position(int x, float inverse_depth) const {
    return static_cast<float>(x) + shift_ * (inverse_depth - inverse_convergence_);
  }
  bool Connected(float a, float b) const { return a > 0 && b > 0 && a >= b * same_layer_ && b >= a * same_layer_; }
  float InverseAt(int x, int y) const {
    const float z = view_.depth_m.Contains(x, y) ? view_.depth_m(x, y) : 0.0F;
    return z > 0 ? 1 / z : 0.0F;
  }

  void ReadRow(int y) {
    for (int x = 0; x < width_; ++x) {
      front_.inverse_depth[x] = InverseAt(x, y);
      front_.color[x] = view_.color(x, y);
      front_.alpha[x] = 1;
      fringe_.inverse_depth[x] = fringe_.alpha[x] = 0;
      behind_.inverse_depth[x] = hidden_.depth_m(x, y) > 0 ? 1 / hidden_.depth_m(x, y) : 0.0F;
      behind_.color[x] = hidden_.color(x, y);
    }
    FillUnknown();
    for (int x = 0; x < width_; ++x)
      if (behind_.inverse_depth[x] > 0) Separate(x, y);
  }

  // Unknown depth goes with the farther known neighbour in the row; a row without any lies on the screen.
  void FillUnknown() {
    std::vector<float>& inverse = front_.inverse_depth;
    for (int x = 0; x < width_; ++x) {
      if (inverse[x] > 0) continue;
      int end = x;
      while (end < width_ && inverse[end] <= 0) ++end;
      const float left = x > 0 ? inverse[x - 1] : 0.0F, right = end < width_ ? inverse[end] : 0.0F;
      const float fill = left > 0 && right > 0 ? std::min(left, right) : std::max(left, right);
      std::fill(inverse.begin() + x, inverse.begin() + end, fill > 0 ? fill : inverse_convergence_);
      x = end;
    }
  }

  // At an edge a pixel is a mixture. On the background's side its share of foreground becomes a fringe that moves with
  // the foreground; on the foreground's side its share of background is replaced by the new background.
  void Separate(int x, int y) {
    const float own = front_.inverse_depth[x];
    const bool background = Connected(own, behind_.inverse_depth[x]);
    float other = own;  // across the edge: the nearest around a background pixel, the farthest around a foreground one
    int to_x = 0, to_y = 0;
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const float there = InverseAt(x + dx, y + dy);
        if (there <= 0 || Connected(there, own)) continue;
        if (background ? there > other : there < other) other = there, to_x = dx, to_y = dy;
      }
    if (background) behind_.inverse_depth[x] = own;  // one surface, seen and unseen
    if (to_x == 0 && to_y == 0) return;
    const Rgb8 mixed = view_.color(x, y), behind = hidden_.color(x, y);
    // Two pixels into the foreground its colour is its own.
    const int inward = background ? 2 : -1;
    const int fx = x + inward * to_x, fy = y + inward * to_y;
    if (!Connected(InverseAt(fx, fy), background ? other : own)) return;
    const Rgb8 foreground = view_.color(fx, fy);
    if (background) {
      const float alpha = ForegroundShare(mixed, foreground, behind, 0.0F);
      if (alpha > 0) front_.color[x] = alpha < 0.5F ? Unmix(mixed, foreground, alpha) : behind;
      behind_.color[x] = front_.color[x];
      fringe_.inverse_depth[x] = other;
      fringe_.alpha[x] = alpha;
    } else {
      front_.alpha[x] = std::max(0.5F, ForegroundShare(mixed, foreground, behind, 1.0F));
    }
  }

  void PutOpaque(int t, float inverse_depth, float x, const RowLayer* layer) {
    if (t < 0 || t >= width_ || inverse_depth <= opaque_[t].inverse_depth) return;
    opaque_[t] = {inverse_depth, x, layer};
  }
  // Between two places of a surface in this eye; what is turned away is not seen.
  template <typename Put>
  void Span(float from, float to, const Put& put) const {
    const int first = std::max(0, static_cast<int>(std::ceil(from)));
    const int last = std::min(width_ - 1, static_cast<int>(std::floor(to)));
    for (int t = first; t <= last; ++t) put(t, (static_cast<float>(t) - from) / (to - from));
  }
  void OpaqueSpan(int x, float inverse_a, float inverse_b, const RowLayer* layer) {
    const float from = Position(x, inverse_a), to = Position(x + 1, inverse_b);
    if (from < to)
      Span(from, to, [&](int t, float f) {
        PutOpaque(t, inverse_a + f * (inverse_b - inverse_a), static_cast<float>(x) + f, layer);
      });
  }
  void SoftSpan(int x, float inverse_a, float inverse_b, const Premultiplied& a, const Premultiplied& b) {
    const float from = Position(x, inverse_a), to = Position(x + 1, inverse_b);
    if (from < to)
      Span(from, to, [&](int t, float f) {
        const float inverse = inverse_a + f * (inverse_b - inverse_a);
        if (inverse > soft_depth_[t]) soft_depth_[t] = inverse, soft_[t] = Lerp(a, b, f);
      });
  }
  // A surface ends half a pixel beyond the centre of its last pixel.
  void HalfPixel(int x, int side, const RowLayer& layer) {
    const float inverse = layer.inverse_depth[x], centre = Position(x, inverse);
    const float from = side < 0 ? centre - 0.5F : centre, to = side < 0 ? centre : centre + 0.5F;
    Span(from, to, [&](int t, float) { PutOpaque(t, inverse, static_cast<float>(x), &layer); });
  }

  Premultiplied FrontAt(int x, int y) const {
    const float alpha = front_.alpha[x];
    return TakeOut(front_.color[x], alpha < 1 ? hidden_.color(x, y) : Rgb8{}, alpha);
  }
  Premultiplied FringeAt(int x, int y) const { return TakeOut(view_.color(x, y), front_.color[x], fringe_.alpha[x]); }

  void DrawFront(int y) {
    const std::vector<float>& inverse = front_.inverse_depth;
    for (int x = 0; x < width_; ++x) {
      const bool joined = x + 1 < width_ && Connected(inverse[x], inverse[x + 1]);
      if (joined && front_.alpha[x] == 1 && front_.alpha[x + 1] == 1)
        OpaqueSpan(x, inverse[x], inverse[x + 1], &front_);
      else if (joined)
        SoftSpan(x, inverse[x], inverse[x + 1], FrontAt(x, y), FrontAt(x + 1, y));
      if (!joined && front_.alpha[x] == 1) HalfPixelUnlessFringed(x, 1);
      if (x > 0 && !Connected(inverse[x], inverse[x - 1]) && front_.alpha[x] == 1) HalfPixelUnlessFringed(x, -1);
    }
  }
  void HalfPixelUnlessFringed(int x, int side) {
    const int next = x + side;
    if (next >= 0 && next < width_ && Connected(fringe_.inverse_depth[next], front_.inverse_depth[x])) return;
    HalfPixel(x, side, front_);
  }

  void DrawFringe(int y) {
    const std::vector<float>& fringe = fringe_.inverse_depth;
    const std::vector<float>& front = front_.inverse_depth;
    for (int x = 0; x < width_; ++x) {
      if (fringe[x] <= 0) continue;
      const Premultiplied here = FringeAt(x, y);
      if (x + 1 < width_ && Connected(fringe[x], front[x + 1]))
        SoftSpan(x, fringe[x], front[x + 1], here, FrontAt(x + 1, y));
      else if (x + 1 < width_ && Connected(fringe[x], fringe[x + 1]))
        SoftSpan(x, fringe[x], fringe[x + 1], here, FringeAt(x + 1, y));
      else if (here.alpha > 0)
        SoftSpan(x, fringe[x], fringe[x], here, {});
      if (x > 0 && Connected(fringe[x], front[x - 1]))
        SoftSpan(x - 1, front[x - 1], fringe[x], FrontAt(x - 1, y), here);
      else if (here.alpha > 0 && !(x > 0 && Connected(fringe[x], fringe[x - 1])))
        SoftSpan(x - 1, fringe[x], fringe[x], {}, here);
    }
  }

  // Only where the view itself left a gap: what is continued must not cover what is seen.
  void DrawBehind() {
    std::vector<Sample> seen = opaque_;
    std::fill(opaque_.begin(), opaque_.end(), Sample{});
    const std::vector<float>& inverse = behind_.inverse_depth;
    for (int x = 0; x < width_; ++x) {
      if (inverse[x] <= 0) continue;
      if (x + 1 < width_ && Connected(inverse[x], inverse[x + 1]))
        OpaqueSpan(x, inverse[x], inverse[x + 1], &behind_);
      else
        HalfPixel(x, 1, behind_);
      if (x == 0 || !Connected(inverse[x], inverse[x - 1])) HalfPixel(x, -1, behind_);
    }
    for (int t = 0; t < width_; ++t)
      if (seen[t].layer != nullptr) opaque_[t] = seen[t];
  }

  // Gaps that are left mirror the farther of their two sides as far as its layer goes.
  void FillGaps() {
    for (int t = 0; t < width_; ++t) {
      if (opaque_[t].layer != nullptr) continue;
      int end = t;
      while (end < width_ && opaque_[end].layer == nullptr) ++end;
      const bool has_left = t > 0, has_right = end < width_;
      if (!has_left && !has_right) {  // nothing arrives in the row at all: cannot be for valid geometry
        for (int i = t; i < end; ++i) opaque_[i] = {inverse_convergence_, static_cast<float>(i), &front_};
        return;
      }
      const bool from_left = has_left && (!has_right || opaque_[t - 1].inverse_depth <= opaque_[end].inverse_depth);
      const int border = from_left ? t - 1 : end, step = from_left ? 1 : -1;
      Sample last = opaque_[border];
      for (int i = border + step; i >= t && i < end; i += step) {
        const int mirrored = 2 * border - i;
        if (mirrored >= 0 && mirrored < width_ && opaque_[mirrored].layer != nullptr &&
            Connected(opaque_[mirrored].inverse_depth, last.inverse_depth))
          last = opaque_[mirrored];
        opaque_[i] = last;
      }
      t = end;
    }
  }

  Rgb8 Compose(int t) const {
    const Sample& sample = opaque_[t];
    const int x = static_cast<int>(sample.x);
    const float f = sample.x - static_cast<float>(x);
    const std::vector<Rgb8>& color = sample.layer->color;
    const Rgb8 base = f > 0 ? LerpColor(color[x], color[x + 1], f) : color[x];
    if (soft_depth_[t] <= sample.inverse_depth) return base;
    const Premultiplied& over = soft_[t];
    const float through = 1 - over.alpha;
    return {ToByte(over.r + through * static_cast<float>(base.r)),
            ToByte(over.g + through * static_cast<float>(base.g)),
            ToByte(over.b + through * static_cast<float>(base.b))};
  }

  const RenderView view_;
  const HiddenBackground& hidden_;
  const int width_;
  const float same_layer_, shift_, inverse_convergence_;
  RowLayer front_, fringe_, behind_;
  std::vector<Sample> opaque_;
  std::vector<float> soft_depth_;
  std::vector<Premultiplied> soft_;
};

void Blacken(Image<Rgb8>& image, int first, int last) {
  for (int y = 0; y < image.height(); ++y) std::fill(image.row(y) + first, image.row(y) + last, Rgb8{});
}

}  // namespace

absl::Status StereoOptions::Validate() const {
  if (baseline_m && !(*baseline_m >= 0 && std::isfinite(*baseline_m)))
    return absl::InvalidArgumentError(absl::StrFormat("baseline_m = %g, must be >= 0", *baseline_m));
  if (!(divergence_percent > 0 && divergence_percent <= 20))
    return absl::InvalidArgumentError(
        absl::StrFormat("divergence_percent = %g, must be in (0, 20]", divergence_percent));
  if (convergence_m && !(*convergence_m > 0))
    return absl::InvalidArgumentError(absl::StrFormat("convergence_m = %g, must be > 0", *convergence_m));
  return absl::OkStatus();
}

absl::StatusOr<StereoGeometry> ResolveStereo(const Camera& camera, const StereoOptions& options,
                                             const DepthDistribution& depth) {
  RETURN_IF_ERROR(options.Validate());
  if (!(depth.near_m > 0 && depth.median_m >= depth.near_m && depth.far_m >= depth.median_m &&
        std::isfinite(depth.far_m)))
    return absl::InvalidArgumentError(
        absl::StrFormat("depth distribution near %g, median %g, far %g m: must ascend from above 0", depth.near_m,
                        depth.median_m, depth.far_m));
  StereoGeometry geometry;
  geometry.focal_px = camera.fx;
  const double near = 1 / depth.near_m, far = 1 / depth.far_m, range = near - far;
  // A flat scene has no range to stretch over the divergence; a quarter of its own nearness stands in.
  geometry.baseline_m = options.baseline_m.value_or(options.divergence_percent / 100 * camera.width /
                                                    (camera.fx * std::max(range, near / 4)));
  geometry.convergence_m = options.convergence_m.value_or(1 / std::max(1 / depth.median_m, near - range / 3));
  const double in_front = geometry.DisparityPx(depth.near_m), behind = geometry.DisparityPx(depth.far_m);
  const double limit = kMaxDisparityShare * camera.width;
  if (std::max(std::abs(in_front), std::abs(behind)) > limit)
    return absl::InvalidArgumentError(absl::StrFormat(
        "baseline_m = %g with convergence_m = %g gives disparities from %.1f to %.1f px, must stay within "
        "%.1f px (a fifth of the width): choose a smaller baseline or divergence",
        geometry.baseline_m, geometry.convergence_m, behind, in_front, limit));
  geometry.window_px = options.floating_window ? static_cast<int>(std::ceil(std::max(0.0, in_front))) : 0;
  // What is nearer than the 1st percentile uncovers a little more.
  geometry.background.reach_px = std::clamp(static_cast<int>(std::ceil(1.25 * (in_front - behind))) + 2, 4, 256);
  // An edge is what tears by about a pixel; noise of upsampled depth stays below the lower bound.
  const double at_median = geometry.focal_px * geometry.baseline_m / depth.median_m;
  geometry.background.layer_gap = static_cast<float>(std::clamp(1.0 / std::max(at_median, 1.0), 0.015, 0.04));
  return geometry;
}

Image<Rgb8> RenderEye(const RenderView& view, const HiddenBackground& hidden, const StereoGeometry& geometry,
                      double offset, int threads, Image<uint8_t>* missing) {
  Image<Rgb8> out(view.color.width(), view.color.height());
  if (missing != nullptr) *missing = Image<uint8_t>(out.width(), out.height());
  ParallelRows(out.height(), threads, [&](int begin, int end) {
    EyeRenderer renderer(view, hidden, geometry, offset);
    for (int y = begin; y < end; ++y) renderer.Render(y, out.row(y), missing != nullptr ? missing->row(y) : nullptr);
  });
  return out;
}

StereoPair RenderStereo(const RenderView& view, const HiddenBackground& hidden, const StereoGeometry& geometry,
                        const StereoOptions& options, int threads) {
  const auto recorded = [&] {
    Image<Rgb8> copy(view.color.width(), view.color.height());
    for (int y = 0; y < copy.height(); ++y) std::copy_n(view.color.row(y), copy.width(), copy.row(y));
    return copy;
  };
  const auto made = [&](double offset) { return RenderEye(view, hidden, geometry, offset, threads); };
  StereoPair pair;
  switch (options.made) {
    case MadeEye::kLeft:
      pair = {made(-1.0), recorded()};
      break;
    case MadeEye::kRight:
      pair = {recorded(), made(1.0)};
      break;
    case MadeEye::kBoth:
      pair = {made(-0.5), made(0.5)};
      break;
  }
  const int window = std::min(geometry.window_px, pair.left.width());
  Blacken(pair.left, 0, window);
  Blacken(pair.right, pair.right.width() - window, pair.right.width());
  return pair;
}

}  // namespace depthtween
