#include "core/capture/depth_edges.h"

#include <algorithm>
#include <cmath>

#include "core/fill/depth_noise.h"

namespace depthtween {
namespace {

// Wider than a slant seen over the pixels that are bridged, and than the noise of any sensor we know.
constexpr float kJumpShare = 0.05F;
constexpr int kBridgedPx = 3;  // distance of the two pixels that a jump parts
constexpr int kNormalRadius = 3;

bool Apart(float a, float b) { return std::abs(a - b) > kJumpShare * std::min(a, b); }

// The direction in which the pixels around (x, y) change from one side of `middle` to the other; unit, or 0.
DepthEdge WithNormal(ImageView<const float> depth, float x, float y, float middle) {
  float across_x = 0, across_y = 0;
  const int left = static_cast<int>(std::floor(x)), top = static_cast<int>(std::floor(y));
  for (int py = std::max(0, top - kNormalRadius); py <= std::min(depth.height() - 1, top + 1 + kNormalRadius); ++py)
    for (int px = std::max(0, left - kNormalRadius); px <= std::min(depth.width() - 1, left + 1 + kNormalRadius);
         ++px) {
      const float z = depth(px, py), dx = static_cast<float>(px) - x, dy = static_cast<float>(py) - y;
      if (z <= 0 || dx * dx + dy * dy > (kNormalRadius + 0.5F) * (kNormalRadius + 0.5F)) continue;
      across_x += z > middle ? dx : -dx;
      across_y += z > middle ? dy : -dy;
    }
  const float length = std::hypot(across_x, across_y);
  if (length <= 0) return {.x = x, .y = y};
  return {.x = x, .y = y, .normal_x = across_x / length, .normal_y = across_y / length};
}

}  // namespace

std::vector<DepthEdge> FindDepthEdges(ImageView<const float> depth) {
  std::vector<DepthEdge> edges;
  // Walks along one row (or column): `at` gives the depth at a step, `place` turns a step into a position.
  const auto walk = [&](int length, auto at, auto place, bool along_x) {
    int last = -1;  // the measured pixel before
    for (int i = 0; i < length; ++i) {
      const float z = at(i);
      if (z <= 0) continue;
      const int before = last;
      last = i;
      if (before < 0 || i - before > kBridgedPx) continue;
      const float a = at(before);
      if (!Apart(a, z)) continue;
      const float half = 0.5F * static_cast<float>(before + i);
      const auto [x, y] = place(half);
      DepthEdge edge = WithNormal(depth, x, y, 0.5F * (a + z));
      // The other walk finds the edges that lie along this one.
      const float nx = edge.normal_x, ny = edge.normal_y;
      if (along_x ? std::abs(nx) < std::abs(ny) : std::abs(ny) <= std::abs(nx)) continue;
      if (nx == 0 && ny == 0) continue;
      const float nearer = std::min(a, z);
      const int inside_x = static_cast<int>(std::lround(x - kInsideEdgePx * nx));
      const int inside_y = static_cast<int>(std::lround(y - kInsideEdgePx * ny));
      if (!depth.Contains(inside_x, inside_y)) continue;
      const float inside = depth(inside_x, inside_y);
      if (inside <= 0 || Apart(inside, nearer)) continue;
      edge.near_m = nearer;
      edges.push_back(edge);
    }
  };
  for (int y = 0; y < depth.height(); ++y)
    walk(
        depth.width(), [&](int i) { return depth(i, y); },
        [&](float i) { return std::pair<float, float>(i, static_cast<float>(y)); }, true);
  for (int x = 0; x < depth.width(); ++x)
    walk(
        depth.height(), [&](int i) { return depth(x, i); },
        [&](float i) { return std::pair<float, float>(static_cast<float>(x), i); }, false);
  return edges;
}

}  // namespace depthtween
