#include <map>
#include <memory>
#include <utility>

#include "client/cli/commands.h"
#include "client/cli/submission.h"

namespace depthtween::cli {
namespace {

// As `depthtween-core sceneflow` names them.
const std::map<std::string, v1::SceneFlowOptions::Method> kMethods = {
    {"ours", v1::SceneFlowOptions::METHOD_OURS},
    {"pd-flow", v1::SceneFlowOptions::METHOD_PD_FLOW},
    {"sr-flow", v1::SceneFlowOptions::METHOD_SR_FLOW},
    {"layered-flow", v1::SceneFlowOptions::METHOD_LAYERED_FLOW}};
const std::map<std::string, v1::SceneFlowOptions::Format> kFormats = {{"npz", v1::SceneFlowOptions::FORMAT_NPZ},
                                                                      {"flo", v1::SceneFlowOptions::FORMAT_FLO},
                                                                      {"kitti", v1::SceneFlowOptions::FORMAT_KITTI}};

struct SceneFlowCommand {
  SubmissionOptions submission;
  std::string method = "ours";
  std::vector<std::string> formats = {"npz"};
  int every = 1;
  double baseline_m = 0.1;
};

template <typename Value>
std::vector<std::string> Names(const std::map<std::string, Value>& values) {
  std::vector<std::string> names;
  for (const auto& [name, value] : values) names.push_back(name);
  return names;
}

int SceneFlow(const SceneFlowCommand& command) {
  v1::Job order;
  v1::SceneFlowOptions& options = *order.mutable_scene_flow_options();
  options.set_method(kMethods.at(command.method));
  for (const std::string& format : command.formats) options.add_formats(kFormats.at(format));
  options.set_every(command.every);
  options.set_baseline_m(command.baseline_m);
  return RunSubmission(command.submission, std::move(order));
}

}  // namespace

void AddSceneFlowCommand(CLI::App& app, int* exit_code) {
  const auto command = std::make_shared<SceneFlowCommand>();
  CLI::App* subcommand = app.add_subcommand(
      "sceneflow",
      "Upload a recording with depth for every colour frame and queue a job for the 3-D motion of its pixels");
  AddSubmissionOptions(*subcommand, command->submission);
  subcommand->add_option("--method", command->method, "How: ours, pd-flow, sr-flow, layered-flow")
      ->type_name("NAME")
      ->check(CLI::IsMember(Names(kMethods)))
      ->capture_default_str();
  subcommand
      ->add_option("--format", command->formats,
                   "Beside npz, which is always there, with commas between them: flo, kitti")
      ->delimiter(',')
      ->type_name("NAMES")
      ->check(CLI::IsMember(Names(kFormats)))
      ->capture_default_str();
  subcommand->add_option("--every", command->every, "From every N-th colour frame to the N-th after it")
      ->type_name("N")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  subcommand->add_option("--baseline", command->baseline_m, "Of the disparities of format kitti, metres")
      ->type_name("M")
      ->check(CLI::Range(1e-4, 100.0))
      ->capture_default_str();
  subcommand->footer(
      "OUT gets what 'depthtween-core sceneflow' writes: report.json, preview.png, and by format sceneflow/*.npz,\n"
      "flow/*.flo with depth_change/*.pfm, or kitti/. A recording with less depth than colour is for\n"
      "'depthtween submit --scene-flow'.\n"
      "\n"
      "Example:  depthtween sceneflow recording --format flo,kitti -o motion\n");
  subcommand->callback([command, exit_code] { *exit_code = SceneFlow(*command); });
}

}  // namespace depthtween::cli
