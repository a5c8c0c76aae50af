// Semi-rigid scene flow, for comparison: a re-implementation of the idea, not the authors' code.
//
// One rigid motion of the whole frame is aligned directly, colour and depth together; then every pixel has a twist of
// its own about it, found from the pixels of its surface in a small window (local rigidity) and kept piecewise constant
// by weighted total variation of the field of twists, coarse to fine.
// Source:   Quiroga, Brox, Devernay and Crowley, Dense Semi-rigid Scene Flow Estimation from RGBD Images, ECCV 2014.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_SR_FLOW_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_SR_FLOW_H_

#include "core/sceneflow/frame_pair.h"

namespace depthtween {

// As RigidWindowsFlow; confidence is 1 everywhere and nothing is hidden: the method does not say.
absl::StatusOr<SceneFlow> SemiRigidFlow(const FramePair& pair);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_SR_FLOW_H_
