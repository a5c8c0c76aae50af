#include "core/metrics/regions.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace depthtween {
namespace {

// The nearest and the farthest known depth of a 3x3 window; far_m = 0 when none is known.
struct Range {
  float near_m = std::numeric_limits<float>::max();
  float far_m = 0.0F;
};

Range WindowRange(ImageView<const float> depth_m, int x, int y) {
  Range range;
  for (int ny = std::max(y - 1, 0); ny <= std::min(y + 1, depth_m.height() - 1); ++ny) {
    for (int nx = std::max(x - 1, 0); nx <= std::min(x + 1, depth_m.width() - 1); ++nx) {
      const float there = depth_m(nx, ny);
      if (!(there > 0.0F)) continue;
      range = {std::min(range.near_m, there), std::max(range.far_m, there)};
    }
  }
  return range;
}

// Marks every pixel within rows dy in [-radius, radius] and columns [-reach(dy), reach(dy)] of a marked one.
template <typename Reach>
Image<uint8_t> Dilate(ImageView<const uint8_t> mask, int radius, Reach reach) {
  const int width = mask.width(), height = mask.height();
  Image<uint8_t> grown(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (mask(x, y) == 0) continue;
      for (int ny = std::max(y - radius, 0); ny <= std::min(y + radius, height - 1); ++ny)
        std::fill(grown.row(ny) + std::max(x - reach(ny - y), 0),
                  grown.row(ny) + std::min(x + reach(ny - y) + 1, width), uint8_t{1});
    }
  }
  return grown;
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
    case Region::kFast:
      return "fast";
    case Region::kStatic:
      return "static";
    case Region::kDisoccluded:
      return "disoccluded";
    case Region::kUntextured:
      return "untextured";
  }
  return "";
}

Image<uint8_t> DepthJumps(ImageView<const float> depth_m) {
  Image<uint8_t> mask(depth_m.width(), depth_m.height());
  for (int y = 0; y < depth_m.height(); ++y) {
    for (int x = 0; x < depth_m.width(); ++x) {
      const Range range = WindowRange(depth_m, x, y);
      mask(x, y) = range.far_m - range.near_m > kEdgeJumpM ? 1 : 0;
    }
  }
  return mask;
}

Image<uint8_t> Silhouettes(ImageView<const float> depth_m) {
  Image<uint8_t> mask(depth_m.width(), depth_m.height());
  for (int y = 0; y < depth_m.height(); ++y)
    for (int x = 0; x < depth_m.width(); ++x)
      if (depth_m(x, y) > 0.0F) mask(x, y) = WindowRange(depth_m, x, y).far_m - depth_m(x, y) > kEdgeJumpM ? 1 : 0;
  return mask;
}

Image<uint8_t> DilateDisc(ImageView<const uint8_t> mask, int radius) {
  return Dilate(mask, radius, [radius](int dy) {
    int reach = 0;
    while ((reach + 1) * (reach + 1) + dy * dy <= radius * radius) ++reach;
    return reach;
  });
}

Image<uint8_t> DilateSquare(ImageView<const uint8_t> mask, int radius) {
  return Dilate(mask, radius, [radius](int) { return radius; });
}

Image<uint8_t> EdgeBand(ImageView<const float> depth_m) { return DilateDisc(DepthJumps(depth_m), kEdgeBandPx); }

Image<uint8_t> Untextured(ImageView<const Rgb8> color) {
  // Sums over a window from sums over everything above and left of its corners.
  const int width = color.width(), height = color.height();
  Image<double> sums(width + 1, height + 1), squares(width + 1, height + 1);
  for (int y = 0; y < height; ++y) {
    double row_sum = 0.0, row_squares = 0.0;
    for (int x = 0; x < width; ++x) {
      const Rgb8 c = color(x, y);
      const double luma = 0.299 * c.r + 0.587 * c.g + 0.114 * c.b;  // BT.601
      row_sum += luma;
      row_squares += luma * luma;
      sums(x + 1, y + 1) = sums(x + 1, y) + row_sum;
      squares(x + 1, y + 1) = squares(x + 1, y) + row_squares;
    }
  }
  Image<uint8_t> mask(width, height);
  for (int y = 0; y < height; ++y) {
    const int top = std::max(y - kTextureRadiusPx, 0), bottom = std::min(y + kTextureRadiusPx + 1, height);
    for (int x = 0; x < width; ++x) {
      const int left = std::max(x - kTextureRadiusPx, 0), right = std::min(x + kTextureRadiusPx + 1, width);
      const auto over = [&](const Image<double>& table) {
        return table(right, bottom) - table(left, bottom) - table(right, top) + table(left, top);
      };
      const double count = static_cast<double>(right - left) * (bottom - top), mean = over(sums) / count;
      const double variance = over(squares) / count - mean * mean;
      mask(x, y) = variance < kUntexturedLevels * kUntexturedLevels ? 1 : 0;
    }
  }
  return mask;
}

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
