// Draws a depth map's surface after its points have moved: nearest wins, nothing spans a cut.
//
// Shapes:   positions, depth_m and the drawing: W x H.
// Units:    pixels and metres, 0 = unknown.
// Threads:  safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_RASTER_SURFACE_RASTER_H_
#define DEPTHTWEEN_CORE_RASTER_SURFACE_RASTER_H_

#include "core/base/image.h"

namespace depthtween {

struct SurfaceRasterOptions {
  // An edge is drawn while it is at most this long in the target, pixels; longer ones are torn, not stretched.
  float max_edge_px = 2.5F;
  // Neighbours whose depths differ by more than this share of the nearer belong to different surfaces.
  float layer_gap = 0.04F;
};

struct DrawnSurface {
  Image<float> depth_m;  // 0 = nothing lands here
  Image<Flow2> source;   // where in the source the surface seen here came from, pixels (valid where depth_m > 0)
};

// `positions(x, y)` is where source pixel (x, y) lies in the target and `depth_m(x, y)` its depth there; a pixel takes
// part when that depth is positive. Edges are cut where `depth_m` jumps. Triangles that turned over are not drawn.
DrawnSurface DrawSurface(ImageView<const Flow2> positions, ImageView<const float> depth_m,
                         const SurfaceRasterOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RASTER_SURFACE_RASTER_H_
