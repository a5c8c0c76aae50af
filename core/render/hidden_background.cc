#include "core/render/hidden_background.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/render/pull_push.h"

namespace depthtween {
namespace {

constexpr std::array<std::array<int, 2>, 8> kAround = {
    {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}}};

struct Pixel {
  int x, y;
};

int Difference(Rgb8 a, Rgb8 b) { return std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b); }

// Where to look and for what: the outcome of following every edge's background under its foreground.
struct Search {
  Image<float> inverse_depth;         // of the view; 0 = unknown
  Image<float> behind_inverse_depth;  // of the layer looked for; 0 = nothing
  Image<uint8_t> guard;               // background that may carry foreground colour
  std::vector<Pixel> pixels;          // where behind_inverse_depth > 0
};

Image<float> InverseDepth(ImageView<const float> depth_m, int threads) {
  Image<float> inverse(depth_m.width(), depth_m.height());
  ParallelRows(depth_m.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < depth_m.width(); ++x) inverse(x, y) = depth_m(x, y) > 0 ? 1.0F / depth_m(x, y) : 0.0F;
  });
  return inverse;
}

// Farthest and nearest known inverse depth of the 3 x 3 pixels around each pixel of a row.
void RangeAround(const Image<float>& inverse, int y, std::vector<float>& farthest, std::vector<float>& nearest) {
  const int width = inverse.width();
  const float* rows[3] = {inverse.row(std::max(0, y - 1)), inverse.row(y),
                          inverse.row(std::min(inverse.height() - 1, y + 1))};
  constexpr float kUnknown = 1e30F;
  std::vector<float> low(width + 2, kUnknown), high(width + 2, 0.0F);
  for (const float* row : rows)
    for (int x = 0; x < width; ++x) {
      low[x + 1] = std::min(low[x + 1], row[x] > 0 ? row[x] : kUnknown);
      high[x + 1] = std::max(high[x + 1], row[x]);
    }
  for (int x = 0; x < width; ++x) {
    farthest[x] = std::min({low[x], low[x + 1], low[x + 2]});
    nearest[x] = std::max({high[x], high[x + 1], high[x + 2]});
  }
}

// Marks both sides of every depth edge.
void FindEdges(float layer_gap, int threads, Search& search) {
  const int width = search.inverse_depth.width(), height = search.inverse_depth.height();
  ParallelRows(height, threads, [&](int begin, int end) {
    std::vector<float> farthest(width), nearest(width);
    for (int y = begin; y < end; ++y) {
      RangeAround(search.inverse_depth, y, farthest, nearest);
      for (int x = 0; x < width; ++x) {
        const float own = search.inverse_depth(x, y);
        if (farthest[x] < own * (1 - layer_gap)) search.behind_inverse_depth(x, y) = farthest[x];
        search.guard(x, y) = own > 0 && own < nearest[x] * (1 - layer_gap);
      }
    }
  });
}

// Grows a front from `front` ring by ring, alternating 4 and 8 neighbours so that rings stay round. `step` marks a
// neighbour and says whether it is new.
template <typename Step>
void Grow(std::vector<Pixel> front, int rings, int width, int height, const Step& step) {
  std::vector<Pixel> next;
  for (int ring = 0; ring < rings && !front.empty(); ++ring) {
    next.clear();
    for (const Pixel from : front)
      for (int k = 0; k < (ring % 2 == 0 ? 4 : 8); ++k) {
        const Pixel to = {from.x + kAround[k][0], from.y + kAround[k][1]};
        if (to.x < 0 || to.y < 0 || to.x >= width || to.y >= height) continue;
        if (step(from, to, ring)) next.push_back(to);
      }
    front.swap(next);
  }
}

// Takes each edge's background away from the edge, to all sides.
void FollowAllAround(int reach, float behind, Search& search) {
  const Image<float>& inverse = search.inverse_depth;
  const int width = inverse.width(), height = inverse.height();
  std::vector<Pixel> edge;
  Image<int16_t> reached(width, height, -1);  // the ring
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (search.behind_inverse_depth(x, y) > 0) edge.push_back({x, y}), reached(x, y) = 0;
  search.pixels = edge;
  Grow(std::move(edge), reach - 1, width, height, [&](Pixel from, Pixel to, int ring) {
    const float layer = search.behind_inverse_depth(from.x, from.y);
    float& there = search.behind_inverse_depth(to.x, to.y);
    if (layer >= inverse(to.x, to.y) * behind) return false;
    int16_t& reached_there = reached(to.x, to.y);
    // Of several layers that arrive together the farthest stays, whatever the order they come in.
    if (reached_there == ring + 1) there = std::min(there, layer);
    if (reached_there >= 0) return false;
    reached_there = static_cast<int16_t>(ring + 1);
    there = layer;
    search.pixels.push_back(to);
    return true;
  });
}

// The same along rows, from edges whose background is on the side of `step` -1 (left) or 1.
void FollowRows(int reach, float behind, int step, int threads, Search& search) {
  const int width = search.inverse_depth.width();
  ParallelRows(search.inverse_depth.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      const float* inverse = search.inverse_depth.row(y);
      float* found = search.behind_inverse_depth.row(y);
      float layer = 0;
      for (int i = 1, left = 0; i < width; ++i) {
        const int x = step < 0 ? i : width - 1 - i;
        const float beside = inverse[x + step];
        if (beside > 0 && beside < inverse[x] * behind) layer = beside, left = reach;
        if (left > 0 && layer < inverse[x] * behind)
          found[x] = found[x] > 0 ? std::min(found[x], layer) : layer, --left;
        else
          left = 0;
      }
    }
  });
}

Search FollowBackground(const RenderView& view, const HiddenBackgroundOptions& options, int threads) {
  const int width = view.depth_m.width(), height = view.depth_m.height();
  const float behind = 1 - options.layer_gap;
  Search search{InverseDepth(view.depth_m, threads), Image<float>(width, height), Image<uint8_t>(width, height), {}};
  const Image<float>& inverse = search.inverse_depth;
  FindEdges(options.layer_gap, threads, search);
  if (options.sides == EdgeSides::kAllAround) {
    FollowAllAround(options.reach_px, behind, search);
  } else {
    search.behind_inverse_depth.Fill(0.0F);
    if (options.sides != EdgeSides::kRight) FollowRows(options.reach_px, behind, -1, threads, search);
    if (options.sides != EdgeSides::kLeft) FollowRows(options.reach_px, behind, 1, threads, search);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        if (search.behind_inverse_depth(x, y) > 0) search.pixels.push_back({x, y});
  }
  std::vector<Pixel> guarded;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (search.guard(x, y) != 0) guarded.push_back({x, y});
  if (options.guard_px == 0) search.guard.Fill(0), guarded.clear();
  std::vector<Pixel> all_guarded = guarded;
  Grow(std::move(guarded), options.guard_px - 1, width, height, [&](Pixel from, Pixel to, int) {
    const float a = inverse(from.x, from.y), b = inverse(to.x, to.y);
    if (search.guard(to.x, to.y) != 0 || a < b * behind || b < a * behind) return false;
    search.guard(to.x, to.y) = 1;
    all_guarded.push_back(to);
    return true;
  });
  // A pixel may be background of one edge and foreground of another; then what lies behind it matters more.
  for (const Pixel p : all_guarded)
    if (search.behind_inverse_depth(p.x, p.y) == 0) {
      search.behind_inverse_depth(p.x, p.y) = inverse(p.x, p.y);
      search.pixels.push_back(p);
    }
  return search;
}

// Colours of the layer where it comes into sight straight left, right, above and below pixel (x, y), added to what
// pull-push says: lines that run into the edge go on behind it for a while before they blur.
LayerSample ContinueLines(int x, int y, ImageView<const Rgb8> color, const Search& search, float layer_gap,
                          LayerSample sample) {
  constexpr int kReachPx = 16;
  static const std::array<float, kReachPx + 1> fade = [] {
    std::array<float, kReachPx + 1> weights;
    for (int d = 0; d <= kReachPx; ++d) weights[d] = 2 * std::exp(-0.2F * static_cast<float>(d));
    return weights;
  }();
  const float behind = search.behind_inverse_depth(x, y);
  const float farthest = behind * (1 - 2 * layer_gap), nearest = behind / (1 - layer_gap);
  for (int k = 0; k < 4; ++k)
    for (int d = 1; d <= kReachPx; ++d) {
      const int nx = x + d * kAround[k][0], ny = y + d * kAround[k][1];
      if (!color.Contains(nx, ny)) break;
      const float there = search.inverse_depth(nx, ny);
      if (there > nearest || there <= 0 || search.guard(nx, ny) != 0) continue;
      if (there >= farthest) {
        const Rgb8 c = color(nx, ny);
        const float weight = fade[d], share = weight / (sample.weight + weight);
        sample.value[0] += share * (static_cast<float>(c.r) - sample.value[0]);
        sample.value[1] += share * (static_cast<float>(c.g) - sample.value[1]);
        sample.value[2] += share * (static_cast<float>(c.b) - sample.value[2]);
        sample.weight += weight;
      }
      break;
    }
  return sample;
}

// Pixels within `radius` (a square) of a marked one.
Image<uint8_t> Widen(const Image<uint8_t>& marked, int radius, int threads) {
  const int width = marked.width(), height = marked.height();
  Image<uint8_t> rows(width, height), out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0, until = 0; x < width + radius; ++x) {
        if (x < width && marked(x, y) != 0) until = x + 2 * radius + 1;
        if (x >= radius && x < until) rows(x - radius, y) = 1;
      }
  });
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int ny = std::max(0, y - radius); ny <= std::min(height - 1, y + radius); ++ny)
        for (int x = 0; x < width; ++x) out(x, y) |= rows(x, ny);
  });
  return out;
}

// Marks where a frame's motion does not lead to the same colour: there it cannot be continued. `distrusted` stays
// marked.
Image<uint8_t> DistrustMotion(ImageView<const Rgb8> color, const NeighborFrame& neighbor,
                              const Image<uint8_t>& distrusted, int threads) {
  constexpr int kSameColor = 36;  // sum over channels: noise and a little change of light
  Image<uint8_t> out = distrusted.Clone();
  ParallelRows(color.height(), threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < color.width(); ++x) {
        if (distrusted(x, y) != 0) continue;
        const Flow2 motion = neighbor.motion(x, y);
        const int nx = static_cast<int>(std::lround(static_cast<float>(x) + motion.u));
        const int ny = static_cast<int>(std::lround(static_cast<float>(y) + motion.v));
        out(x, y) = !color.Contains(nx, ny) || Difference(color(x, y), neighbor.view.color(nx, ny)) > kSameColor;
      }
  });
  return out;
}

// Finds points of the background in another frame.
class NeighborLookup {
 public:
  // Motion is continued from pixels that are not `distrusted`.
  NeighborLookup(const NeighborFrame& neighbor, ImageView<const float> inverse_depth,
                 ImageView<const uint8_t> distrusted, float layer_gap, int threads)
      : view_(neighbor.view),
        same_layer_(1 - layer_gap),
        motion_(neighbor.motion, inverse_depth, distrusted, layer_gap, threads) {}

  // The colour of the point that lies hidden at pixel (x, y) at 1 / `inverse_depth`, if this frame shows it.
  bool Find(int x, int y, float inverse_depth, Rgb8& color) const {
    const LayerSample motion = motion_.Infer(x, y, inverse_depth, kMotionCells);
    if (motion.weight <= 0) return false;
    const float fx = static_cast<float>(x) + motion.value[0], fy = static_cast<float>(y) + motion.value[1];
    if (!(fx >= 0 && fy >= 0 && fx <= static_cast<float>(view_.color.width() - 1) &&
          fy <= static_cast<float>(view_.color.height() - 1)))
      return false;
    const int x0 = static_cast<int>(fx), y0 = static_cast<int>(fy);
    // The pixels between which it lies and those around them: one of another layer would show through.
    for (int ny = y0 - 1; ny <= y0 + 2; ++ny)
      for (int nx = x0 - 1; nx <= x0 + 2; ++nx) {
        const float z = view_.depth_m.Clamped(nx, ny);
        if (z <= 0 || z * inverse_depth < same_layer_ || z * inverse_depth * same_layer_ > 1) return false;
      }
    const float ax = fx - static_cast<float>(x0), ay = fy - static_cast<float>(y0);
    const auto channel = [&](uint8_t Rgb8::*member) {
      const auto at = [&](int dx, int dy) { return static_cast<float>(view_.color.Clamped(x0 + dx, y0 + dy).*member); };
      const float top = at(0, 0) * (1 - ax) + at(1, 0) * ax, bottom = at(0, 1) * (1 - ax) + at(1, 1) * ax;
      return static_cast<uint8_t>(top * (1 - ay) + bottom * ay + 0.5F);
    };
    color = {channel(&Rgb8::r), channel(&Rgb8::g), channel(&Rgb8::b)};
    return true;
  }

 private:
  static constexpr int kMotionCells = 2;  // 8 x 8 pixels: the mean of some measurements

  const RenderView view_;
  const float same_layer_;
  const LayerPyramid motion_;
};

}  // namespace

absl::Status HiddenBackgroundOptions::Validate() const {
  if (reach_px < 1 || reach_px > 256)
    return absl::InvalidArgumentError(absl::StrFormat("reach_px = %d, must be in 1..256", reach_px));
  if (guard_px < 0 || guard_px > 8)
    return absl::InvalidArgumentError(absl::StrFormat("guard_px = %d, must be in 0..8", guard_px));
  if (!(layer_gap > 0 && layer_gap <= 0.5F))
    return absl::InvalidArgumentError(absl::StrFormat("layer_gap = %g, must be in (0, 0.5]", layer_gap));
  return absl::OkStatus();
}

HiddenBackground FindHiddenBackground(const RenderView& view, const std::vector<NeighborFrame>& neighbors,
                                      const HiddenBackgroundOptions& options, int threads) {
  const int width = view.depth_m.width(), height = view.depth_m.height();
  const Search search = FollowBackground(view, options, threads);
  HiddenBackground out{Image<Rgb8>(width, height), Image<float>(width, height), Image<uint8_t>(width, height)};
  constexpr int kChunk = 2048;
  const int count = static_cast<int>(search.pixels.size());
  const auto for_each_open = [&](const auto& body) {
    ParallelFor((count + kChunk - 1) / kChunk, threads, [&](int chunk) {
      for (int i = chunk * kChunk; i < std::min(count, (chunk + 1) * kChunk); ++i) {
        const auto [x, y] = search.pixels[i];
        if (out.source(x, y) == 0) body(x, y, search.behind_inverse_depth(x, y));
      }
    });
  };
  // Measured motion of a background is dragged along by what moves before it: with flow of OpenCV's DIS, leaving out
  // this much doubles what other frames gain (stereo_bench temporal).
  constexpr int kDraggedPx = 8;
  const Image<uint8_t> dragged = neighbors.empty() ? Image<uint8_t>() : Widen(search.guard, kDraggedPx, threads);
  for (const NeighborFrame& neighbor : neighbors) {
    const Image<uint8_t> distrusted = DistrustMotion(view.color, neighbor, dragged, threads);
    const NeighborLookup lookup(neighbor, search.inverse_depth, distrusted, options.layer_gap, threads);
    for_each_open([&](int x, int y, float behind) {
      if (behind == search.inverse_depth(x, y)) return;  // on the background's side nothing is hidden
      if (!lookup.Find(x, y, behind, out.color(x, y))) return;
      out.depth_m(x, y) = 1.0F / behind;
      out.source(x, y) = kHiddenSeen;
    });
  }
  const LayerPyramid pyramid(view.color, search.inverse_depth, search.guard, options.layer_gap, threads);
  for_each_open([&](int x, int y, float behind) {
    const LayerSample sample = pyramid.Infer(x, y, behind);
    if (sample.weight <= 0) return;
    out.color(x, y) = ContinueLines(x, y, view.color, search, options.layer_gap, sample).Color();
    out.depth_m(x, y) = 1.0F / sample.inverse_depth;
    out.source(x, y) = kHiddenInferred;
  });
  return out;
}

}  // namespace depthtween
