// Optical flow and depth change of one level together: L1 data terms of colour and range, total variation along the
// surface, solved by a primal-dual method.
//
//   min over (u, v, w)   sum  light |I1(x + u, y + v) - I0|  +  range |Z1(x + u, y + v) - Z0 - w|
//                             + smooth_flow |T grad (u - u0)| + ... (v) + smooth_range |T grad (w - w0)|
// with T the ties between neighbours and (u0, v0, w0) a reference that need not be smooth. Depth and w count in pixels:
// metres times focal length over the pixel's depth, so that all three are of one kind.
//
// Source:   Jaimez et al. 2015 (the terms); Pock and Chambolle, Diagonal Preconditioning for First Order Primal-Dual
//           Algorithms, ICCV 2011 (the solver).
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_RANGE_FLOW_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_RANGE_FLOW_H_

#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/sceneflow/pyramid.h"

namespace depthtween {

struct RangeField {
  Image<float> u, v, w;  // pixels of the level; w: depth change in pixels, as above
};
RangeField ZeroRangeField(int width, int height);

struct RangeFlowOptions {
  float light = 12.0F;         // weight of a difference of the whole range of light
  float range = 0.5F;          // weight of a pixel of depth
  float range_falloff = 0.1F;  // range counts 1 / (1 + falloff (Zx^2 + Zy^2 + Zt^2)), pixels: less at jumps
  float smooth_flow = 1.0F, smooth_range = 1.0F;
  int warps = 5, iterations = 80;  // of each warp
};

// Improves `field` in place. `trust` scales the data terms of each pixel, in [0,1]. Shapes: all as the level's.
void SolveRangeFlow(const PyramidLevel& level, const SurfaceTies& ties, ImageView<const float> trust,
                    const RangeField& reference, const DepthNoise& noise, const RangeFlowOptions& options, int threads,
                    RangeField& field);

// From standing still at the coarsest level down to `finest`, one of `levels`; coarser than 0, the result is enlarged.
// The field is of the size of levels[0], in its pixels. Cancelled when `pair.stop` fires.
absl::StatusOr<RangeField> RangeFlowCoarseToFine(const FramePair& pair, const std::vector<PyramidLevel>& levels,
                                                 int finest);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_RANGE_FLOW_H_
