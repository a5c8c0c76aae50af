#include "core/sequence/upsample_names.h"

namespace depthtween {

const std::vector<std::string>& UpsampleMethods() {
  static const auto* const kNames = [] {
    auto* const names = new std::vector<std::string>(BaselineNames());
    names->insert(names->begin(), "ours");
    return names;
  }();
  return *kNames;
}

const std::vector<std::string>& BaselineNames() {
  static const auto* const kNames =
      new std::vector<std::string>{"hold", "nearest", "linear", "dolson", "dolson-mode", "tracking", "flow-warp"};
  return *kNames;
}

const std::vector<std::string>& PresetNames() {
  static const auto* const kNames = new std::vector<std::string>{"fast", "balanced", "best", "reference"};
  return *kNames;
}

const std::vector<std::string>& PartNames() {
  static const auto* const kNames = new std::vector<std::string>{
      "settle", "recover", "thin",  "draw", "solve", "propagation", "median", "witnesses", "silhouettes",
      "opti",   "point",   "plane", "proj", "rigid", "reg",         "short",  "occlusion", "topology"};
  return *kNames;
}

const std::vector<std::string>& LiteralNames() {
  static const auto* const kNames = new std::vector<std::string>{
      "closest", "coherence", "kernels", "occlusion", "point", "proj", "rigid", "short", "topology"};
  return *kNames;
}

}  // namespace depthtween
