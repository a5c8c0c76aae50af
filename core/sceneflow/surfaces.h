// Which pixels of a depth map lie on one surface.
//
// Threads: pure.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_SURFACES_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_SURFACES_H_

#include "core/base/image.h"
#include "core/fill/depth_noise.h"

namespace depthtween {

// Connected parts of a depth map (> 0 everywhere) without a jump inside, numbered from 0 in the order of their first
// pixels. Neighbours are joined on one layer, or where each lies where the slant on the other's side leads: a floor
// seen at a grazing angle steps by more than a layer's gap from row to row.
Image<int> LabelSurfaces(ImageView<const float> depth_m, const DepthNoise& noise);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_SURFACES_H_
