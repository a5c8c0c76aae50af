#include "core/metrics/regions.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace depthtween {
namespace {

// Marks pixels for which `marks(here, neighbour)` holds with a known 3x3 neighbour.
template <typename Marks>
Image<uint8_t> MarkByNeighbours(ImageView<const float> depth_m, Marks marks) {
  Image<uint8_t> mask(depth_m.width(), depth_m.height());
  for (int y = 0; y < depth_m.height(); ++y) {
    const int y0 = std::max(y - 1, 0), y1 = std::min(y + 1, depth_m.height() - 1);
    for (int x = 0; x < depth_m.width(); ++x) {
      const float here = depth_m(x, y);
      if (!(here > 0.0F)) continue;
      const int x0 = std::max(x - 1, 0), x1 = std::min(x + 1, depth_m.width() - 1);
      for (int ny = y0; ny <= y1; ++ny)
        for (int nx = x0; nx <= x1; ++nx)
          if (depth_m(nx, ny) > 0.0F && marks(here, depth_m(nx, ny))) mask(x, y) = 1;
    }
  }
  return mask;
}

}  // namespace

std::string_view RegionName(Region region) {
  switch (region) {
    case Region::kAll:
      return "all";
    case Region::kEdgeBand:
      return "edge_band";
    case Region::kInterior:
      return "interior";
    case Region::kMoving:
      return "moving";
    case Region::kStatic:
      return "static";
    case Region::kDisoccluded:
      return "disoccluded";
  }
  return "";
}

Image<uint8_t> DepthJumps(ImageView<const float> depth_m) {
  return MarkByNeighbours(depth_m, [](float here, float there) { return std::abs(here - there) > kEdgeJumpM; });
}

Image<uint8_t> Silhouettes(ImageView<const float> depth_m) {
  return MarkByNeighbours(depth_m, [](float here, float there) { return there - here > kEdgeJumpM; });
}

Image<uint8_t> Dilate(ImageView<const uint8_t> mask, int radius) {
  const int width = mask.width(), height = mask.height();
  Image<uint8_t> wide(width, height), grown(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (mask(x, y) != 0)
        std::fill(wide.row(y) + std::max(x - radius, 0), wide.row(y) + std::min(x + radius + 1, width), 1);
  for (int y = 0; y < height; ++y)
    for (int ny = std::max(y - radius, 0); ny <= std::min(y + radius, height - 1); ++ny)
      for (int x = 0; x < width; ++x) grown(x, y) |= wide(x, ny);
  return grown;
}

Image<uint8_t> EdgeBand(ImageView<const float> depth_m) { return Dilate(DepthJumps(depth_m), kEdgeBandPx); }

void KeyVisibility::Restart(int width, int height) {
  position_ = Image<Flow2>(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) position_(x, y) = {static_cast<float>(x), static_cast<float>(y)};
  alive_ = Image<uint8_t>(width, height, 1);
}

void KeyVisibility::Advance(const TrueMotion& motion) {
  for (int y = 0; y < alive_.height(); ++y) {
    for (int x = 0; x < alive_.width(); ++x) {
      if (alive_(x, y) == 0) continue;
      Flow2& p = position_(x, y);
      const int px = static_cast<int>(std::lround(p.u)), py = static_cast<int>(std::lround(p.v));
      const bool seen =
          motion.valid.Contains(px, py) && motion.valid(px, py) != 0 && motion.hidden_in_next(px, py) == 0;
      if (!seen) {
        alive_(x, y) = 0;
        continue;
      }
      const Flow2 step = motion.flow_px(px, py);
      p = {p.u + step.u, p.v + step.v};
    }
  }
}

Image<uint8_t> KeyVisibility::Unseen() const {
  const int width = alive_.width(), height = alive_.height();
  Image<uint8_t> hit(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (alive_(x, y) == 0) continue;
      const Flow2 p = position_(x, y);
      const int px = static_cast<int>(std::lround(p.u)), py = static_cast<int>(std::lround(p.v));
      if (hit.Contains(px, py)) hit(px, py) = 1;
    }
  }
  Image<uint8_t> unseen(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto seen_at = [&](int nx, int ny) { return hit.Contains(nx, ny) && hit(nx, ny) != 0; };
      const bool grew = (seen_at(x - 1, y) && seen_at(x + 1, y)) || (seen_at(x, y - 1) && seen_at(x, y + 1));
      unseen(x, y) = hit(x, y) == 0 && !grew ? 1 : 0;
    }
  }
  return unseen;
}

}  // namespace depthtween
