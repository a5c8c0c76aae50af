#include "core/sceneflow/surfaces.h"

#include <numeric>
#include <vector>

namespace depthtween {
namespace {

// Whether two neighbours, the middle ones of four pixels in a row, lie on one surface: on one layer, or each where the
// slant on the other's side leads.
bool Continues(float before, float a, float b, float after, const DepthNoise& noise) {
  if (SameLayer(a, b, noise)) return true;
  // Planes are linear in inverse depth.
  const float expected_b = 2.0F / a - 1.0F / before, expected_a = 2.0F / b - 1.0F / after;
  return expected_b > 0.0F && expected_a > 0.0F && SameLayer(1.0F / expected_b, b, noise) &&
         SameLayer(1.0F / expected_a, a, noise);
}

}  // namespace

Image<int> LabelSurfaces(ImageView<const float> depth_m, const DepthNoise& noise) {
  const int width = depth_m.width(), height = depth_m.height();
  std::vector<int> parent(depth_m.pixel_count());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const int here = y * width + x;
      const auto joined = [&](int dx, int dy) {
        return Continues(depth_m.Clamped(x - 2 * dx, y - 2 * dy), depth_m.Clamped(x - dx, y - dy), depth_m(x, y),
                         depth_m.Clamped(x + dx, y + dy), noise);
      };
      if (x > 0 && joined(1, 0)) parent[root(here)] = root(here - 1);
      if (y > 0 && joined(0, 1)) parent[root(here)] = root(here - width);
    }
  Image<int> labels(width, height);
  std::vector<int> number(parent.size(), -1);
  int count = 0;
  for (int i = 0; i < static_cast<int>(parent.size()); ++i) {
    int& n = number[root(i)];
    if (n < 0) n = count++;
    labels.data()[i] = n;
  }
  return labels;
}

}  // namespace depthtween
