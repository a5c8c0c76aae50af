#include "core/upsample/thin_motion.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <utility>

#include "core/flow/dense_flow.h"

namespace depthtween {
namespace {

constexpr int kThin = 20;         // what is narrower is thin, pixels
constexpr int kCell = 3;          // one pixel of a thin thing's edge is followed in each square cell of this side
constexpr int kWindowRadius = 7;  // by the pixels of its layer so far around it, ...
constexpr size_t kFewest = 12;    // of which there must be so many; ...
constexpr size_t kMany = 100;     // ... of more than this, every second one will do
constexpr int kReach = 3;         // pixels from where it is expected ...
constexpr int kFirstReach = 6;    // ... and in the first frame, whose motion nothing foretells
// Mean differences over a window's pixels, sRGB units a channel.
constexpr float kExplained = 7.0F;     // nothing is left to look for
constexpr float kFound = 14.0F;        // what is found matches this well ...
constexpr float kBetter = 0.6F;        // ... and leaves at most this share of what flow leaves
constexpr float kCostPerPixel = 0.5F;  // of distance from where it is expected: along a rope all places look alike
constexpr int kTruncation = 180;       // of one pixel, all channels: something else may hide part of a thing
constexpr float kSameAsFlow = 0.75F;   // pixels: nearer to flow there is nothing to propose
constexpr int kSpread = 5;             // pixels around a place that move like it

// Whether a pixel is at the edge of a thing that ends again on the other side of it.
bool AtEdgeOfThin(const Key& key, int x, int y, const DepthNoise& noise) {
  const float z = key.depth_m(x, y);
  if (z <= 0 || key.distance(x, y) > 0) return false;
  const auto behind = [&](int dx, int dy) {
    if (!key.depth_m.Contains(x + dx, y + dy)) return false;
    const float other = key.depth_m(x + dx, y + dy);
    return other - z > kLayerGap * z && !SameLayer(z, other, noise);
  };
  for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
    if (!behind(dx, dy)) continue;
    for (int d = 1; d < kThin; ++d)
      if (behind(-d * dx, -d * dy)) return true;
  }
  return false;
}

int Whole(float v) { return static_cast<int>(std::lround(v)); }

}  // namespace

ThinMotion::ThinMotion(const Key& key, ImageView<const Rgb8> color, const DepthNoise& noise) {
  const int width = color.width(), height = color.height();
  for (int top = 0; top < height; top += kCell)
    for (int left = 0; left < width; left += kCell) {
      Place place{.x = -1};
      for (int i = 0; i < kCell * kCell && place.x < 0; ++i) {
        const int x = left + i % kCell, y = top + i / kCell;
        if (x < width && y < height && AtEdgeOfThin(key, x, y, noise)) place.x = x, place.y = y;
      }
      if (place.x < 0) continue;
      const float z = key.depth_m(place.x, place.y);
      for (int dy = -kWindowRadius; dy <= kWindowRadius; ++dy)
        for (int dx = -kWindowRadius; dx <= kWindowRadius; ++dx) {
          const int x = place.x + dx, y = place.y + dy;
          if (color.Contains(x, y) && key.distance(x, y) == 0 && SameLayer(z, key.depth_m(x, y), noise))
            place.pixels.push_back({static_cast<int8_t>(dx), static_cast<int8_t>(dy), color(x, y)});
        }
      if (place.pixels.size() > kMany)
        std::erase_if(place.pixels, [](const WindowPixel& p) { return (p.dx + p.dy) % 2 != 0; });
      if (place.pixels.size() >= kFewest) places_.push_back(std::move(place));
    }
}

// Mean difference of a place's pixels, moved by (u, v); more than `limit` at least if it is more.
float ThinMotion::Difference(const Place& place, ImageView<const Rgb8> frame, int u, int v, float limit) {
  const float over = 1.0F / (3.0F * static_cast<float>(place.pixels.size()));
  const int cx = place.x + u, cy = place.y + v;
  const bool inside = cx >= kWindowRadius && cy >= kWindowRadius && cx < frame.width() - kWindowRadius &&
                      cy < frame.height() - kWindowRadius;
  const float enough =
      std::min(limit / over, static_cast<float>(kTruncation) * static_cast<float>(place.pixels.size()));
  const int too_much = static_cast<int>(std::max(0.0F, enough));
  int sum = 0;
  for (const WindowPixel& p : place.pixels) {
    const int x = cx + p.dx, y = cy + p.dy;
    int difference = kTruncation;
    if (inside || frame.Contains(x, y)) {
      const Rgb8 c = frame(x, y);
      difference = std::abs(c.r - p.color.r) + std::abs(c.g - p.color.g) + std::abs(c.b - p.color.b);
    }
    sum += std::min(kTruncation, difference);
    if (sum > too_much) break;
  }
  return static_cast<float>(sum) * over;
}

Image<Flow2> ThinMotion::Follow(ImageView<const Rgb8> color, ImageView<const Flow2> forward) {
  constexpr float kNone = std::numeric_limits<float>::max();
  Image<Flow2> motion(color.width(), color.height());
  Image<float> cost(color.width(), color.height(), kNone);  // of the motion taken
  const int reach = first_ ? kFirstReach : kReach;
  first_ = false;
  for (Place& place : places_) {
    if (!place.in_sight) continue;
    const auto along = [&](Flow2 m) {
      if (forward.empty()) return m;
      const Flow2 step = SampleFlow(forward, static_cast<float>(place.x) + m.u, static_cast<float>(place.y) + m.v);
      return Flow2{m.u + step.u, m.v + step.v};
    };
    place.along_flow = along(place.along_flow);
    int best_u = Whole(place.along_flow.u), best_v = Whole(place.along_flow.v);
    const float left_by_flow = Difference(place, color, best_u, best_v, kNone);
    float best = left_by_flow;
    const auto look = [&](int u, int v, float penalty) {
      const float difference = Difference(place, color, u, v, best - penalty) + penalty;
      if (difference < best) best = difference, best_u = u, best_v = v;
    };
    // It is expected where flow takes it now, or where it was going.
    const Flow2 now = along(place.found);
    look(Whole(now.u), Whole(now.v), 0);
    look(Whole(place.found.u + place.last_step.u), Whole(place.found.v + place.last_step.v), 0);
    if (best > kExplained) {
      const int from_u = best_u, from_v = best_v;
      for (int dv = -reach; dv <= reach; ++dv)
        for (int du = -reach; du <= reach; ++du)
          look(from_u + du, from_v + dv, kCostPerPixel * std::hypot(static_cast<float>(du), static_cast<float>(dv)));
    }
    place.in_sight = best <= kFound;
    if (!place.in_sight) continue;
    const Flow2 found = {static_cast<float>(best_u), static_cast<float>(best_v)};
    place.last_step = {found.u - place.found.u, found.v - place.found.v};
    place.found = found;
    if (best > kBetter * left_by_flow ||
        std::hypot(found.u - place.along_flow.u, found.v - place.along_flow.v) < kSameAsFlow)
      continue;
    // What hid what lay behind, one pixel beside it, is to be compared too.
    for (const WindowPixel& p : place.pixels) {
      if (std::max(std::abs(p.dx), std::abs(p.dy)) > kSpread) continue;
      for (int y = place.y + p.dy + best_v - 1; y <= place.y + p.dy + best_v + 1; ++y)
        for (int x = place.x + p.dx + best_u - 1; x <= place.x + p.dx + best_u + 1; ++x) {
          if (!motion.Contains(x, y) || cost(x, y) <= best) continue;
          cost(x, y) = best;
          motion(x, y) = {-found.u, -found.v};
        }
    }
  }
  return motion;
}

}  // namespace depthtween
