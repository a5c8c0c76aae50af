#include "core/solve/surface.h"

#include <cmath>

namespace depthtween {

float DepthBetweenPixels(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise) {
  const int nx = static_cast<int>(std::floor(x + 0.5F)), ny = static_cast<int>(std::floor(y + 0.5F));
  if (!depth_m.Contains(nx, ny)) return 0.0F;
  const float nearest = depth_m(nx, ny);
  if (nearest <= 0) return 0.0F;
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  float sum = 0, weight = 0;
  for (int dy = 0; dy < 2; ++dy)
    for (int dx = 0; dx < 2; ++dx) {
      if (!depth_m.Contains(x0 + dx, y0 + dy)) continue;
      const float z = depth_m(x0 + dx, y0 + dy), w = (dx ? ax : 1 - ax) * (dy ? ay : 1 - ay);
      if (z > 0 && SameLayer(z, nearest, noise)) sum += w / z, weight += w;
    }
  return weight > 0 ? weight / sum : nearest;
}

Triple<float> NormalAt(ImageView<const float> depth_m, const IdealPixels& pixels, int x, int y, int reach,
                       const DepthNoise& noise) {
  const float z = depth_m(x, y);
  if (z <= 0) return {};
  // From one side to the other; where one side is another layer, from the pixel itself.
  const auto span = [&](int dx, int dy) -> Triple<float> {
    int from = 0, to = 0;
    const auto joined = [&](int at) {
      const int nx = x + at * dx, ny = y + at * dy;
      return depth_m.Contains(nx, ny) && depth_m(nx, ny) > 0 && SameLayer(depth_m(nx, ny), z, noise);
    };
    if (joined(-reach)) from = -reach;
    if (joined(reach)) to = reach;
    const auto point = [&](int at) {
      const int nx = x + at * dx, ny = y + at * dy;
      return pixels.PointAt(static_cast<float>(nx), static_cast<float>(ny), depth_m(nx, ny));
    };
    return point(to) - point(from);
  };
  const Triple<float> normal = Cross(span(0, 1), span(1, 0));
  const float length = std::sqrt(Dot(normal, normal));
  if (!(length > 0)) return {};
  return (1.0F / length) * normal;
}

}  // namespace depthtween
