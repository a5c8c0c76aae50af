#include "core/raster/registered_depth.h"

#include "core/raster/surface_raster.h"

namespace depthtween {

Image<float> RegisterDepth(ImageView<const float> depth_m, const Registration& registration) {
  const int width = depth_m.width(), height = depth_m.height();
  Image<Flow2> positions(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (depth_m(x, y) <= 0) continue;
      const Flow2 move = registration.Displacement(width, height, x, y, depth_m(x, y));
      positions(x, y) = {static_cast<float>(x) + move.u, static_cast<float>(y) + move.v};
    }
  return DrawSurface(positions, depth_m, width, height, {}).depth_m;
}

}  // namespace depthtween
