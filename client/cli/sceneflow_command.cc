#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands.h"
#include "client/cli/order.h"
#include "client/cli/submission.h"
#include "core/flags/option_flags.h"
#include "core/options/scene_flow_options.h"

namespace depthtween::cli {
namespace {

struct SceneFlowCommand {
  SubmissionOptions submission;
  nlohmann::json document = nlohmann::json::object();
};

}  // namespace

void AddSceneFlowCommand(CLI::App& app, int* exit_code) {
  const auto command = std::make_shared<SceneFlowCommand>();
  CLI::App* subcommand = app.add_subcommand(
      "sceneflow",
      "Upload a recording with depth for every colour frame and queue a job for the 3-D motion of its pixels");
  AddSubmissionOptions(*subcommand, command->submission);
  AddOptionFlags(*subcommand, SceneFlowOptionSpecs(), command->document);
  subcommand->footer(
      "OUT gets what 'depthtween-core sceneflow' writes: report.json, preview.png, and by format sceneflow/*.npz,\n"
      "flow/*.flo with depth_change/*.pfm, or kitti/. For a recording with less depth than colour, use\n"
      "'depthtween submit --scene-flow'.\n"
      "\n"
      "Example:  depthtween sceneflow recording --format flo,kitti -o motion\n");
  subcommand->callback([command, exit_code] {
    *exit_code = RunSubmission(command->submission, OrderOf(JobKind::kSceneFlow, command->document));
  });
}

}  // namespace depthtween::cli
