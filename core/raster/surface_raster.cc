#include "core/raster/surface_raster.h"

#include <algorithm>
#include <cmath>

namespace depthtween {
namespace {

struct Vertex {
  float x, y;       // target pixels
  float inverse_z;  // 1/m
  float sx, sy;     // source pixels
};

float Cross(const Vertex& a, const Vertex& b, float x, float y) {
  return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
}

void DrawTriangle(const Vertex& a, const Vertex& b, const Vertex& c, Image<float>& inverse_z, Image<Flow2>& source) {
  const float area = Cross(a, b, c.x, c.y);
  if (!(area > 1e-3F)) return;  // turned over or edge-on
  const int x0 = std::max(0, static_cast<int>(std::ceil(std::min({a.x, b.x, c.x}))));
  const int x1 = std::min(inverse_z.width() - 1, static_cast<int>(std::floor(std::max({a.x, b.x, c.x}))));
  const int y0 = std::max(0, static_cast<int>(std::ceil(std::min({a.y, b.y, c.y}))));
  const int y1 = std::min(inverse_z.height() - 1, static_cast<int>(std::floor(std::max({a.y, b.y, c.y}))));
  const float scale = 1.0F / area;
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const float wa = Cross(b, c, x, y) * scale, wb = Cross(c, a, x, y) * scale, wc = 1.0F - wa - wb;
      // A hair of tolerance closes the seam between two triangles; the z-test keeps it harmless.
      if (wa < -1e-4F || wb < -1e-4F || wc < -1e-4F) continue;
      // 1/z is affine in the image, so this interpolation is exact for planes.
      const float iz = wa * a.inverse_z + wb * b.inverse_z + wc * c.inverse_z;
      if (iz <= inverse_z(x, y)) continue;
      inverse_z(x, y) = iz;
      source(x, y) = {wa * a.sx + wb * b.sx + wc * c.sx, wa * a.sy + wb * b.sy + wc * c.sy};
    }
}

}  // namespace

DrawnSurface DrawSurface(ImageView<const Flow2> positions, ImageView<const float> depth_m, int width, int height,
                         const SurfaceRasterOptions& options) {
  DrawnSurface drawn{Image<float>(width, height), Image<Flow2>(width, height)};  // depth_m holds 1/z until the end
  const auto vertex = [&](int i, int j) {
    const Flow2 p = positions(i, j);
    return Vertex{p.u, p.v, 1.0F / depth_m(i, j), static_cast<float>(i * options.step),
                  static_cast<float>(j * options.step)};
  };
  const float longest = options.max_stretch * static_cast<float>(options.step);
  const auto joined = [&](const Vertex& a, const Vertex& b) {
    const float dx = a.x - b.x, dy = a.y - b.y;
    if (dx * dx + dy * dy > longest * longest) return false;
    // |za - zb| <= gap * min(za, zb), in inverse depth.
    return std::abs(a.inverse_z - b.inverse_z) <= options.layer_gap * std::min(a.inverse_z, b.inverse_z);
  };
  for (int y = 0; y + 1 < positions.height(); ++y)
    for (int x = 0; x + 1 < positions.width(); ++x) {
      if (depth_m(x + 1, y) <= 0 || depth_m(x, y + 1) <= 0) continue;
      const Vertex right = vertex(x + 1, y), below = vertex(x, y + 1);
      if (!joined(right, below)) continue;
      if (depth_m(x, y) > 0) {
        const Vertex here = vertex(x, y);
        if (joined(here, right) && joined(here, below)) DrawTriangle(here, right, below, drawn.depth_m, drawn.source);
      }
      if (depth_m(x + 1, y + 1) > 0) {
        const Vertex across = vertex(x + 1, y + 1);
        if (joined(across, right) && joined(across, below))
          DrawTriangle(right, across, below, drawn.depth_m, drawn.source);
      }
    }
  for (size_t i = 0; i < drawn.depth_m.pixel_count(); ++i) {
    float& value = drawn.depth_m.data()[i];
    if (value > 0) value = 1.0F / value;
  }
  return drawn;
}

}  // namespace depthtween
