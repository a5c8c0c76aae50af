// The words by which scene flow is asked for, below all that computes it for the reason that upsample_names.h gives.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_SCENE_FLOW_NAMES_H_
#define DEPTHTWEEN_CORE_SEQUENCE_SCENE_FLOW_NAMES_H_

#include <string>
#include <vector>

namespace depthtween {

// "ours", "pd-flow", "sr-flow", "layered-flow". EstimateSceneFlow (core/sceneflow) knows each.
const std::vector<std::string>& SceneFlowMethods();
// "npz", "flo", "kitti": as core/session/scene_flow_files.h writes them.
const std::vector<std::string>& SceneFlowFormats();

inline constexpr double kDefaultBaselineM = 0.1;  // of the disparities of "kitti"

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_SCENE_FLOW_NAMES_H_
