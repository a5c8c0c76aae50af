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
      new std::vector<std::string>{"hold", "nearest", "linear", "dolson", "dolson-mode", "flow-warp"};
  return *kNames;
}

const std::vector<std::string>& PresetNames() {
  static const auto* const kNames = new std::vector<std::string>{"fast", "balanced", "best"};
  return *kNames;
}

const std::vector<std::string>& PartNames() {
  static const auto* const kNames =
      new std::vector<std::string>{"settle", "draw", "propagation", "median", "witnesses", "silhouettes"};
  return *kNames;
}

}  // namespace depthtween
