#include "core/sequence/scene_flow_names.h"

namespace depthtween {

const std::vector<std::string>& SceneFlowMethods() {
  static const auto* const kNames = new std::vector<std::string>{"ours", "pd-flow", "sr-flow", "layered-flow"};
  return *kNames;
}

const std::vector<std::string>& SceneFlowFormats() {
  static const auto* const kNames = new std::vector<std::string>{"npz", "flo", "kitti"};
  return *kNames;
}

}  // namespace depthtween
