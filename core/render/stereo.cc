#include "core/render/stereo.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"

namespace depthtween {
namespace {

constexpr double kMaxDisparityShare = 0.2;  // of the width: the eyes cannot fuse more, and holes dominate

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
  const int share = static_cast<int>(t * 256 + 0.5F);
  const auto mix = [share](int u, int v) { return static_cast<uint8_t>((256 * u + share * (v - u) + 128) >> 8); };
  return {mix(a.r, b.r), mix(a.g, b.g), mix(a.b, b.b)};
}

// The share of foreground in a pixel that may be a mixture: its place on the line between the two colours. 0 where the
// colours are too alike to tell or the pixel is far off that line.
float ForegroundShare(Rgb8 mixed, Rgb8 foreground, Rgb8 background) {
  const auto dot = [](const int(&a)[3], const int(&b)[3]) {
    return static_cast<float>(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
  };
  const int line[3] = {foreground.r - background.r, foreground.g - background.g, foreground.b - background.b};
  const int place[3] = {mixed.r - background.r, mixed.g - background.g, mixed.b - background.b};
  constexpr float kTellApart2 = 3 * 12 * 12;  // above the noise of a camera
  const float length2 = dot(line, line);
  if (length2 < kTellApart2) return 0;
  const float share = dot(line, place) / length2;
  if (dot(place, place) - share * share * length2 > 0.5F * length2) return 0;
  // The ends are widened a little: neither colour is known better.
  return std::clamp((share - 0.03F) / 0.9F, 0.0F, 1.0F);
}

// Background with the share `alpha` of foreground taken out of a mixture, for alpha < 1/2.
Rgb8 Unmix(Rgb8 mixed, Rgb8 foreground, float alpha) {
  const auto channel = [alpha](uint8_t m, uint8_t f) {
    return ToByte((static_cast<float>(m) - alpha * static_cast<float>(f)) / (1 - alpha));
  };
  return {channel(mixed.r, foreground.r), channel(mixed.g, foreground.g), channel(mixed.b, foreground.b)};
}

// 1 / z. Unknown depth goes with the farther known neighbour in the row; a row without any lies on the screen.
Image<float> InverseDepth(ImageView<const float> depth_m, float inverse_convergence, int threads) {
  const int width = depth_m.width();
  Image<float> inverse(width, depth_m.height());
  ParallelRows(depth_m.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      const float* z = depth_m.row(y);
      float* row = inverse.row(y);
      for (int x = 0; x < width; ++x) row[x] = z[x] > 0 ? 1 / z[x] : 0.0F;
      for (int x = 0; x < width; ++x) {
        if (row[x] > 0) continue;
        int known = x;
        while (known < width && row[known] <= 0) ++known;
        const float left = x > 0 ? row[x - 1] : 0.0F, right = known < width ? row[known] : 0.0F;
        const float farther = left > 0 && right > 0 ? std::min(left, right) : std::max(left, right);
        std::fill(row + x, row + known, farther > 0 ? farther : std::max(inverse_convergence, 1e-6F));
        x = known;
      }
    }
  });
  return inverse;
}

// One surface along a row of the view: what stands at each of its pixels.
struct RowLayer {
  std::vector<float> inverse_depth;  // 0 = nothing
  std::vector<Rgb8> color;
  explicit RowLayer(int width) : inverse_depth(width), color(width) {}
};

// Renders row by row: every target row depends on its source row and the two above and below.
class EyeRenderer {
 public:
  // `inverse_depth` is complete.
  EyeRenderer(const RenderView& view, ImageView<const float> inverse_depth, const HiddenBackground& hidden,
              const StereoGeometry& geometry, double offset)
      : view_(view),
        inverse_depth_(inverse_depth),
        hidden_(hidden),
        width_(view.color.width()),
        guard_(geometry.background.guard_px),
        same_layer_(1 - geometry.background.layer_gap),
        shift_(static_cast<float>(-offset * geometry.focal_px * geometry.baseline_m)),
        inverse_convergence_(static_cast<float>(1 / geometry.convergence_m)),
        front_(width_),
        behind_(width_),
        fringe_depth_(width_),
        fringe_alpha_(width_),
        opaque_(width_),
        soft_depth_(width_),
        soft_(width_) {}

  void Render(int y, Rgb8* out, uint8_t* missing) {
    ReadRow(y);
    std::fill(opaque_.begin(), opaque_.end(), Sample{});
    std::fill(soft_depth_.begin(), soft_depth_.end(), 0.0F);
    DrawFront();
    DrawFringe(y);
    if (missing != nullptr)
      for (int t = 0; t < width_; ++t)
        missing[t] = opaque_[t].layer == kNothing && !(soft_depth_[t] > 0 && soft_[t].alpha >= 0.5F);
    DrawBehind();
    FillGaps();
    for (int t = 0; t < width_; ++t) out[t] = Compose(t);
  }

 private:
  enum Layer : uint8_t { kNothing, kBehind, kFront };
  struct Sample {
    float inverse_depth = 0;
    float x = 0;  // place in the source row
    Layer layer = kNothing;
  };

  float Position(int x, float inverse_depth) const {
    return static_cast<float>(x) + shift_ * (inverse_depth - inverse_convergence_);
  }
  bool Connected(float a, float b) const { return a > 0 && b > 0 && a >= b * same_layer_ && b >= a * same_layer_; }
  float InverseAt(int x, int y) const { return inverse_depth_.Contains(x, y) ? inverse_depth_(x, y) : 0.0F; }

  void ReadRow(int y) {
    for (int x = 0; x < width_; ++x) {
      front_.inverse_depth[x] = inverse_depth_(x, y);
      front_.color[x] = view_.color(x, y);
      fringe_depth_[x] = fringe_alpha_[x] = 0;
      behind_.inverse_depth[x] = hidden_.depth_m(x, y) > 0 ? 1 / hidden_.depth_m(x, y) : 0.0F;
      behind_.color[x] = hidden_.color(x, y);
    }
    for (int x = 0; x < width_; ++x)
      if (behind_.inverse_depth[x] > 0) Separate(x, y);
  }

  // The nearest surface across a depth edge, seen from its background: how many pixels away, and in which direction.
  struct Edge {
    int distance = 0;  // 0: none within the guard
    int sx = 0, sy = 0;
    float inverse_depth = 0;
  };
  Edge FindForeground(int x, int y) const {
    const float own = inverse_depth_(x, y);
    Edge edge;
    int sum_x = 0, sum_y = 0;
    for (int ring = 1; ring <= guard_ && edge.distance == 0; ++ring)
      for (int dy = -ring; dy <= ring; ++dy)
        for (int dx = -ring; dx <= ring; dx += std::abs(dy) == ring ? 1 : 2 * ring) {
          const float there = InverseAt(x + dx, y + dy);
          if (there * same_layer_ <= own) continue;
          edge.distance = ring;
          edge.inverse_depth = std::max(edge.inverse_depth, there);
          sum_x += dx, sum_y += dy;
        }
    edge.sx = (sum_x > 0) - (sum_x < 0), edge.sy = (sum_y > 0) - (sum_y < 0);
    return edge;
  }

  // On the background's side of an edge a pixel may be a mixture: its share of foreground becomes a fringe that moves
  // with the foreground.
  void Separate(int x, int y) {
    const float own = front_.inverse_depth[x];
    const bool continued = Connected(own, behind_.inverse_depth[x]);  // one surface, seen and unseen
    if (continued) behind_.inverse_depth[x] = own;
    const Edge edge = FindForeground(x, y);
    if (edge.distance > 0) TakeOutForeground(x, y, edge, continued);
    if (continued) behind_.color[x] = front_.color[x];
  }

  void TakeOutForeground(int x, int y, const Edge& edge, bool continued) {
    // One pixel further into the foreground its colour is its own, and so is the background's beyond the guard.
    const int into = edge.distance + 1, away = guard_ + 1 - edge.distance;
    const int fx = x + into * edge.sx, fy = y + into * edge.sy;
    const int bx = x - away * edge.sx, by = y - away * edge.sy;
    if (!Connected(InverseAt(fx, fy), edge.inverse_depth)) return;
    if (!continued && !Connected(InverseAt(bx, by), front_.inverse_depth[x])) return;
    const Rgb8 mixed = view_.color(x, y), foreground = view_.color(fx, fy);
    const Rgb8 background = continued ? hidden_.color(x, y) : view_.color(bx, by);
    float alpha = ForegroundShare(mixed, foreground, background);
    // Likeness alone does not make foreground: it must reach here from the edge.
    for (int step = 1; step < edge.distance; ++step)
      alpha =
          std::min(alpha, ForegroundShare(view_.color(x + step * edge.sx, y + step * edge.sy), foreground, background));
    if (alpha <= 0 && edge.distance > 1) return;
    if (alpha > 0) front_.color[x] = alpha < 0.5F ? Unmix(mixed, foreground, alpha) : background;
    fringe_depth_[x] = edge.inverse_depth;
    fringe_alpha_[x] = alpha;
  }

  // What is continued behind shows only where the view itself left a gap: it must not cover what is seen.
  void PutOpaque(int t, const Sample& sample) {
    if (opaque_[t].layer <= sample.layer && sample.inverse_depth > opaque_[t].inverse_depth) opaque_[t] = sample;
  }
  // Between two places of a surface in this eye; what is turned away is not seen.
  template <typename Put>
  void Span(float from, float to, const Put& put) const {
    const float last = std::min(to, static_cast<float>(width_ - 1));
    for (int t = static_cast<int>(std::ceil(std::max(0.0F, from))); static_cast<float>(t) <= last; ++t)
      put(t, (static_cast<float>(t) - from) / (to - from));
  }
  void OpaqueSpan(int x, float inverse_a, float inverse_b, Layer layer) {
    const float from = Position(x, inverse_a), to = Position(x + 1, inverse_b);
    if (from < to)
      Span(from, to, [&](int t, float f) {
        PutOpaque(t, {inverse_a + f * (inverse_b - inverse_a), static_cast<float>(x) + f, layer});
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
  void HalfPixel(int x, int side, float inverse, Layer layer) {
    const float centre = Position(x, inverse);
    const float from = side < 0 ? centre - 0.5F : centre, to = side < 0 ? centre : centre + 0.5F;
    Span(from, to, [&](int t, float) { PutOpaque(t, {inverse, static_cast<float>(x), layer}); });
  }

  Premultiplied FrontAt(int x) const { return TakeOut(front_.color[x], {}, 1.0F); }
  Premultiplied FringeAt(int x, int y) const { return TakeOut(view_.color(x, y), front_.color[x], fringe_alpha_[x]); }

  void DrawFront() {
    const std::vector<float>& inverse = front_.inverse_depth;
    for (int x = 0; x < width_; ++x) {
      if (x + 1 < width_ && Connected(inverse[x], inverse[x + 1]))
        OpaqueSpan(x, inverse[x], inverse[x + 1], kFront);
      else
        HalfPixelUnlessFringed(x, 1);
      if (x == 0 || !Connected(inverse[x], inverse[x - 1])) HalfPixelUnlessFringed(x, -1);
    }
  }
  void HalfPixelUnlessFringed(int x, int side) {
    const int next = x + side;
    if (next >= 0 && next < width_ && Connected(fringe_depth_[next], front_.inverse_depth[x])) return;
    HalfPixel(x, side, front_.inverse_depth[x], kFront);
  }

  void DrawFringe(int y) {
    const std::vector<float>& fringe = fringe_depth_;
    const std::vector<float>& front = front_.inverse_depth;
    for (int x = 0; x < width_; ++x) {
      if (fringe[x] <= 0) continue;
      const Premultiplied here = FringeAt(x, y);
      if (x + 1 < width_ && Connected(fringe[x], front[x + 1]))
        SoftSpan(x, fringe[x], front[x + 1], here, FrontAt(x + 1));
      else if (x + 1 < width_ && Connected(fringe[x], fringe[x + 1]))
        SoftSpan(x, fringe[x], fringe[x + 1], here, FringeAt(x + 1, y));
      else if (here.alpha > 0)
        SoftSpan(x, fringe[x], fringe[x], here, {});
      if (x > 0 && Connected(fringe[x], front[x - 1]))
        SoftSpan(x - 1, front[x - 1], fringe[x], FrontAt(x - 1), here);
      else if (here.alpha > 0 && !(x > 0 && Connected(fringe[x], fringe[x - 1])))
        SoftSpan(x - 1, fringe[x], fringe[x], {}, here);
    }
  }

  void DrawBehind() {
    const std::vector<float>& inverse = behind_.inverse_depth;
    for (int x = 0; x < width_; ++x) {
      if (inverse[x] <= 0) continue;
      if (x + 1 < width_ && Connected(inverse[x], inverse[x + 1]))
        OpaqueSpan(x, inverse[x], inverse[x + 1], kBehind);
      else
        HalfPixel(x, 1, inverse[x], kBehind);
      if (x == 0 || !Connected(inverse[x], inverse[x - 1])) HalfPixel(x, -1, inverse[x], kBehind);
    }
  }

  // Gaps that are left go on with the farther of their two sides, or with both, half and half, if they are one layer.
  void FillGaps() {
    for (int t = 0; t < width_; ++t) {
      if (opaque_[t].layer != kNothing) continue;
      int end = t;
      while (end < width_ && opaque_[end].layer == kNothing) ++end;
      const float left = t > 0 ? opaque_[t - 1].inverse_depth : 0.0F;
      const float right = end < width_ ? opaque_[end].inverse_depth : 0.0F;
      const bool one_layer = Connected(left, right);
      const bool only_left = left > 0 && !one_layer && (right <= 0 || left < right);
      const int middle = one_layer ? (t + end) / 2 : only_left ? end : t;
      if (left > 0) Mirror(t - 1, middle, 1);
      if (right > 0) Mirror(end, middle - 1, -1);
      t = end;
    }
  }
  // Continues from `border` up to but not including `end`, as in a mirror as far as the border's layer goes.
  void Mirror(int border, int end, int step) {
    Sample last = opaque_[border];
    for (int t = border + step; (end - t) * step > 0; t += step) {
      const int mirrored = 2 * border - t;
      if (mirrored >= 0 && mirrored < width_ && opaque_[mirrored].layer != kNothing &&
          Connected(opaque_[mirrored].inverse_depth, last.inverse_depth))
        last = opaque_[mirrored];
      opaque_[t] = last;
    }
  }

  Rgb8 Compose(int t) const {
    const Sample& sample = opaque_[t];
    if (sample.layer == kNothing) return {};  // the whole row has left the image
    const int x = static_cast<int>(sample.x);
    const float f = sample.x - static_cast<float>(x);
    const std::vector<Rgb8>& color = sample.layer == kFront ? front_.color : behind_.color;
    const Rgb8 base = f > 0 ? LerpColor(color[x], color[x + 1], f) : color[x];
    if (soft_depth_[t] <= sample.inverse_depth) return base;
    const Premultiplied& over = soft_[t];
    const float through = 1 - over.alpha;
    return {ToByte(over.r + through * static_cast<float>(base.r)),
            ToByte(over.g + through * static_cast<float>(base.g)),
            ToByte(over.b + through * static_cast<float>(base.b))};
  }

  const RenderView view_;
  const ImageView<const float> inverse_depth_;
  const HiddenBackground& hidden_;
  const int width_, guard_;
  const float same_layer_, shift_, inverse_convergence_;
  RowLayer front_, behind_;
  std::vector<float> fringe_depth_, fringe_alpha_;  // foreground mixed into background pixels; depth 0 = none
  std::vector<Sample> opaque_;
  std::vector<float> soft_depth_;
  std::vector<Premultiplied> soft_;
};

void Blacken(Image<Rgb8>& image, int first, int last) {
  for (int y = 0; y < image.height(); ++y) std::fill(image.row(y) + first, image.row(y) + last, Rgb8{});
}

// Twice what separates the eyes of a scene of mountains. What a clip allows is less and depends on its depths: see
// ResolveStereo.
constexpr double kMaxBaselineM = 100.0;

}  // namespace

absl::Status StereoOptions::Validate() const {
  if (baseline_m && !(*baseline_m >= 0 && *baseline_m <= kMaxBaselineM))
    return absl::InvalidArgumentError(
        absl::StrFormat("baseline_m = %g, must be 0 to %g metres", *baseline_m, kMaxBaselineM));
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
  geometry.background.sides = options.made == MadeEye::kLeft    ? EdgeSides::kLeft
                              : options.made == MadeEye::kRight ? EdgeSides::kRight
                                                                : EdgeSides::kLeftAndRight;
  // What is nearer than the 1st percentile uncovers a little more.
  geometry.background.reach_px = std::clamp(static_cast<int>(std::ceil(1.25 * (in_front - behind))) + 2, 4, 256);
  geometry.background.guard_px = 1;  // depth edges of cameras lie a pixel beside colour edges
  // An edge is what tears by about a pixel; noise of upsampled depth stays below the lower bound.
  const double at_median = geometry.focal_px * geometry.baseline_m / depth.median_m;
  geometry.background.layer_gap = static_cast<float>(std::clamp(1.0 / std::max(at_median, 1.0), 0.015, 0.15));
  return geometry;
}

Image<Rgb8> RenderEye(const RenderView& view, const HiddenBackground& hidden, const StereoGeometry& geometry,
                      double offset, int threads, Image<uint8_t>* missing) {
  Image<Rgb8> out(view.color.width(), view.color.height());
  const Image<float> inverse = InverseDepth(view.depth_m, static_cast<float>(1 / geometry.convergence_m), threads);
  if (missing != nullptr) *missing = Image<uint8_t>(out.width(), out.height());
  ParallelRows(out.height(), threads, [&](int begin, int end) {
    EyeRenderer renderer(view, inverse, hidden, geometry, offset);
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
