// What the tasks share: their input, and the part of `assemble` that is about renders.
#ifndef DEPTHTWEEN_CORE_SESSION_TASK_INPUT_H_
#define DEPTHTWEEN_CORE_SESSION_TASK_INPUT_H_

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/io/sequence_folder.h"
#include "core/session/render_run.h"
#include "core/session/scene_flow_run.h"
#include "core/session/tasks.h"
#include "core/session/upsample_run.h"

namespace depthtween {

// What every task but `validate` begins with.
struct TaskInput {
  UpsampleOptions options;
  std::vector<RenderOptions> renders;
  nlohmann::json render;                     // of render-frame
  std::optional<SceneFlowOrder> scene_flow;  // in place of an upsampling
  std::unique_ptr<SequenceFolder> recording;
};

absl::StatusOr<TaskInput> OpenInput(const TaskArguments& arguments);
absl::StatusOr<ClipPlan> ReadClipPlan(const TaskArguments& arguments, const TaskInput& input);

std::string RenderPath(size_t index);

// The videos of all renders, and what the report says of them.
absl::StatusOr<nlohmann::json> AssembleRenders(const Task& task, const TaskInput& input, const ClipPlan& clip);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_TASK_INPUT_H_
