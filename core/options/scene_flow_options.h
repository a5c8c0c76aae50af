// The options of the scene flow of a recording: names, defaults, rules and help stand in scene_flow_options.cc.
#ifndef DEPTHTWEEN_CORE_OPTIONS_SCENE_FLOW_OPTIONS_H_
#define DEPTHTWEEN_CORE_OPTIONS_SCENE_FLOW_OPTIONS_H_

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/options/option.h"

namespace depthtween {

// EstimateSceneFlow (core/sceneflow) knows each.
const std::vector<std::string>& SceneFlowMethods();
// As core/session/scene_flow_files.h writes them.
const std::vector<std::string>& SceneFlowFormats();

struct SceneFlowOrder {
  std::string method = "ours";
  std::vector<std::string> formats = {"npz"};  // at least one
  int every = 1;                               // from every n-th colour frame to the n-th after it
  double baseline_m = 0.1;                     // of the disparities of "kitti"
  int threads = 1;                             // not part of the document: does not change the result
};

const std::vector<OptionSpec>& SceneFlowOptionSpecs();

// As of UpsampleOptions.
nlohmann::json ToJson(const SceneFlowOrder& order);
absl::StatusOr<SceneFlowOrder> ParseSceneFlowOrder(const nlohmann::json& document,
                                                   const std::string& path = "sceneflow");

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_OPTIONS_SCENE_FLOW_OPTIONS_H_
