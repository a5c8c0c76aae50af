#include "core/options/scene_flow_options.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_join.h"
#include "core/options/field_error.h"
#include "core/options/option_members.h"

namespace depthtween {
namespace {

using nlohmann::json;

const OptionMembers<SceneFlowOrder>& SceneFlowMembers() {
  using O = SceneFlowOrder;
  static const auto* const kMembers = [] {
    auto* const members = new OptionMembers<O>;
    members
        ->Add<&O::method>({.name = "method",
                           .help = "How: " + absl::StrJoin(SceneFlowMethods(), ", "),
                           .placeholder = "NAME",
                           .words = SceneFlowMethods()})
        .Add<&O::formats>({.name = "formats",
                           .help = "With commas between them: " + absl::StrJoin(SceneFlowFormats(), ", "),
                           .placeholder = "NAMES",
                           .flag = "--format",
                           .words = SceneFlowFormats()})
        .Add<&O::every>({.name = "every",
                         .help = "From every N-th colour frame to the N-th after it",
                         .placeholder = "N",
                         .min = 1,
                         .max = 1'000'000})
        .Add<&O::baseline_m>({.name = "baseline_m",
                              .help = "Of the disparities of format kitti, metres",
                              .placeholder = "M",
                              .flag = "--baseline",
                              .min = 1e-4,
                              .max = 100.0});
    return members;
  }();
  return *kMembers;
}

}  // namespace

const std::vector<std::string>& SceneFlowMethods() {
  static const auto* const kNames = new std::vector<std::string>{"ours", "pd-flow", "sr-flow", "layered-flow"};
  return *kNames;
}

const std::vector<std::string>& SceneFlowFormats() {
  static const auto* const kNames = new std::vector<std::string>{"npz", "flo", "kitti"};
  return *kNames;
}

const std::vector<OptionSpec>& SceneFlowOptionSpecs() { return SceneFlowMembers().specs(); }

json ToJson(const SceneFlowOrder& order) { return SceneFlowMembers().ToJson(order); }

absl::StatusOr<SceneFlowOrder> ParseSceneFlowOrder(const json& document, const std::string& path) {
  ASSIGN_OR_RETURN(const json filled, FillDocument(SceneFlowOptionSpecs(), document, path));
  SceneFlowOrder order = SceneFlowMembers().FromFilled(filled);
  if (order.formats.empty())
    return FieldError(path + ".formats", "is empty, must be some of: " + absl::StrJoin(SceneFlowFormats(), ", "));
  return order;
}

}  // namespace depthtween
