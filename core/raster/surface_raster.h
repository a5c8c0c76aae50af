// Splats a depth map's surface, as triangles, after its points have moved: z-buffered, torn at depth jumps.
//
// Shapes:   positions and depth_m: one vertex per `step` source pixels, in both directions; the drawing: W x H pixels.
// Units:    pixels and metres, 0 = unknown.
// Threads:  safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_RASTER_SURFACE_RASTER_H_
#define DEPTHTWEEN_CORE_RASTER_SURFACE_RASTER_H_

#include "core/base/image.h"

namespace depthtween {

struct SurfaceRasterOptions {
  // Source pixels between neighbouring vertices: vertex (i, j) is source pixel (i * step, j * step).
  int step = 1;
  // An edge is drawn while it is stretched at most this much in the target; longer ones are torn.
  float max_stretch = 2.5F;
  // Neighbours whose depths differ by more than this share of the nearer belong to different surfaces.
  float layer_gap = 0.04F;
};

struct DrawnSurface {
  Image<float> depth_m;  // 0 = nothing lands here
  Image<Flow2> source;   // where in the source the surface seen here came from, pixels (valid where depth_m > 0)
};

// `positions(x, y)` is where source pixel (x, y) lies in the target and `depth_m(x, y)` its depth there; a pixel takes
// part when that depth is positive. Edges are cut where `depth_m` jumps. Triangles that turned over are not drawn.
DrawnSurface DrawSurface(ImageView<const Flow2> positions, ImageView<const float> depth_m, int width, int height,
                         const SurfaceRasterOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RASTER_SURFACE_RASTER_H_
