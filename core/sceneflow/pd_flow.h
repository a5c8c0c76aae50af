// Primal-dual scene flow, for comparison: a re-implementation of the idea, not the authors' code.
//
// Optical flow and range flow constraints with L1 norms, total variation along the depth surface, coarse to fine.
// Source:   Jaimez, Souiai, Gonzalez-Jimenez and Cremers, A Primal-Dual Framework for Real-Time Dense RGB-D Scene Flow,
//           ICRA 2015. Ours runs at full resolution, with more iterations than real time allows, and weighs in pixels.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_PD_FLOW_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_PD_FLOW_H_

#include "core/sceneflow/frame_pair.h"

namespace depthtween {

// As RigidWindowsFlow; confidence is 1 everywhere and nothing is hidden: the method does not say.
absl::StatusOr<SceneFlow> PrimalDualFlow(const FramePair& pair);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_PD_FLOW_H_
