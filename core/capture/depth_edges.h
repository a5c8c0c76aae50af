// Where one surface hides another in a measured depth map, to a fraction of a pixel: what a colour frame of the same
// instant shows at the same place.
#ifndef DEPTHTWEEN_CORE_CAPTURE_DEPTH_EDGES_H_
#define DEPTHTWEEN_CORE_CAPTURE_DEPTH_EDGES_H_

#include <vector>

#include "core/base/image.h"

namespace depthtween {

struct DepthEdge {
  float x = 0.0F, y = 0.0F;                // pixels; between the last pixel of the nearer surface and the first behind
  float normal_x = 0.0F, normal_y = 0.0F;  // unit, from the nearer surface to the farther one
  float near_m = 0.0F;                     // depth of the nearer surface
};

// How far inside the nearer surface its motion may be looked up, pixels: past the pixels that flow smears over an edge.
inline constexpr float kInsideEdgePx = 3.0F;

// Edges of `depth_m` (metres, 0 = unknown), one for each pair of neighbours in a row or a column that a jump parts, in
// the order of rows, then of columns. Missing pixels are bridged up to two; where the nearer surface is too thin for
// its motion to be looked up, there is no edge. Threads: pure.
std::vector<DepthEdge> FindDepthEdges(ImageView<const float> depth_m);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_CAPTURE_DEPTH_EDGES_H_
