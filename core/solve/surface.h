// A depth map as a surface: depth and normals that never mix two layers.
#ifndef DEPTHTWEEN_CORE_SOLVE_SURFACE_H_
#define DEPTHTWEEN_CORE_SOLVE_SURFACE_H_

#include "core/base/image.h"
#include "core/fill/depth_noise.h"
#include "core/solve/ideal_pixels.h"
#include "core/solve/triple.h"

namespace depthtween {

// Depth at a pixel between pixels: inverse depth (exact for planes) among the corners of the nearest one's layer. 0 if
// the nearest is unknown or outside.
float DepthBetweenPixels(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise);

// Unit normal towards the camera at a pixel, from its neighbours `reach` pixels away that lie in its layer. (0, 0, 0)
// if they do not span a surface.
Triple<float> NormalAt(ImageView<const float> depth_m, const IdealPixels& pixels, int x, int y, int reach,
                       const DepthNoise& noise);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_SURFACE_H_
