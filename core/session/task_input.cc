#include "core/session/task_input.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "core/io/file.h"

namespace depthtween {

using nlohmann::json;

std::string Dump(const json& value) { return value.dump(2, ' ', false, json::error_handler_t::replace) + "\n"; }

std::string RenderPath(size_t index) { return absl::StrCat("renders[", index, "]"); }

absl::StatusOr<TaskInput> OpenInput(const TaskArguments& arguments) {
  TaskInput input;
  ASSIGN_OR_RETURN(const std::string text, ReadFile(arguments.options));
  const json order = json::parse(text, /*cb=*/nullptr, /*allow_exceptions=*/false);
  if (!order.is_object())
    return absl::InvalidArgumentError(absl::StrCat(arguments.options, " must hold a JSON object"));
  for (const auto& [field, value] : order.items()) {
    if (field == "upsample") {
      ASSIGN_OR_RETURN(input.options, ParseUpsampleOptions(value));
    } else if (field == "scene_flow") {
      ASSIGN_OR_RETURN(input.scene_flow, ParseSceneFlowOrder(value, "scene_flow_options"));
    } else if (field == "renders") {
      ASSIGN_OR_RETURN(input.renders, ParseRenders(value));
    } else if (field == "render") {
      input.render = value;
    } else {
      return FieldError(field, "is not known: an order has upsample, scene_flow, renders or render");
    }
  }
  input.options.threads = arguments.threads;
  input.options.keep_motion = arguments.keep_motion;
  if (input.scene_flow) input.scene_flow->threads = arguments.threads;
  ASSIGN_OR_RETURN(input.recording, SequenceFolder::Open(arguments.sequence));
  return input;
}

absl::StatusOr<ClipPlan> ReadClipPlan(const TaskArguments& arguments, const TaskInput& input) {
  ASSIGN_OR_RETURN(const std::string constants, ReadFile(arguments.constants));
  return ParseClipPlan(constants, input.recording->sequence(), input.options);
}

}  // namespace depthtween
