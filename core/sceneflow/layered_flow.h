// Layered scene flow, for comparison: a re-implementation of the idea, not the authors' code.
//
// The frame is cut into a few layers by depth. Each moves rigidly, fitted to dense flow and depth, plus a smooth
// deviation; the layers' order in depth says what occludes what, and occluded pixels follow their layer. Cutting,
// fitting and refining alternate.
//
// Source:   Sun, Sudderth and Pfister, Layered RGBD Scene Flow Estimation, CVPR 2015. They solve for layer supports by
//           graph cuts; we take the likelier layer and let neighbours vote.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_LAYERED_FLOW_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_LAYERED_FLOW_H_

#include "core/sceneflow/frame_pair.h"

namespace depthtween {

// As RigidWindowsFlow; confidence is 1 where a pixel is believed visible, 1/2 where hidden.
absl::StatusOr<SceneFlow> LayeredFlow(const FramePair& pair);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_LAYERED_FLOW_H_
