// depthtween-core sceneflow: metric 3-D motion of every pixel, from a recording with depth for every colour frame.
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/flags/option_flags.h"
#include "core/io/file.h"
#include "core/io/sequence_folder.h"
#include "core/options/scene_flow_options.h"
#include "core/session/scene_flow_run.h"
#include "core/tools/commands.h"
#include "core/tools/progress_bar.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

struct SceneFlowArguments {
  std::string sequence, out;
  nlohmann::json document = nlohmann::json::object();
  int threads = AvailableThreads();
  bool json = false, force = false;
};

absl::Status RunSceneFlow(const SceneFlowArguments& arguments) {
  StopOnSignals signals;
  ASSIGN_OR_RETURN(SceneFlowOrder order, ParseSceneFlowOrder(arguments.document));
  order.threads = arguments.threads;
  ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> folder, SequenceFolder::Open(arguments.sequence));
  for (const std::string& warning : folder->Warnings(arguments.threads))
    std::cerr << "warning: " << warning << std::endl;
  nlohmann::json report;
  {
    CountLine counter("computed", "pairs of frames");
    ASSIGN_OR_RETURN(report, ComputeSceneFlow(*folder, order, arguments.out, arguments.force, signals.token(),
                                              [&](int done, int total) { counter.Show(done, total); }));
  }
  if (arguments.json) {
    std::cout << report.dump(2) << std::endl;
    return absl::OkStatus();
  }
  double seconds = 0.0;
  for (const nlohmann::json& pair : report["pairs"]) seconds += pair["seconds"].get<double>();
  const int count = static_cast<int>(report["pairs"].size());
  std::cout << absl::StrFormat("%d pairs of frames in %.1f s (%.2f s each): %s, picture: %s\n", count, seconds,
                               seconds / count, arguments.out, JoinPath(arguments.out, "preview.png"));
  return absl::OkStatus();
}

}  // namespace

void AddSceneFlowCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<SceneFlowArguments>();
  CLI::App* const command =
      app.add_subcommand("sceneflow", "Compute the 3-D motion of every pixel, from depth for every colour frame");
  command->footer(
      "From each colour frame to the next, with depth at the same rate. OUT gets report.json, preview.png (colour, "
      "motion\n"
      "across the picture by hue, motion in depth: red comes nearer) and, by format:\n"
      "  npz    sceneflow/STEM.npz: flow (u, v: pixels), motion (x right, y down, z forward: metres, in the camera's\n"
      "         frame), depth (metres), confidence (0 = no answer), hidden (in the next frame)\n"
      "  flo    flow/STEM.flo (Middlebury: pixels) and depth_change/STEM.pfm (metres, positive = away)\n"
      "  kitti  kitti/flow/STEM.png (16 bits: u = (R - 32768) / 64 pixels, v likewise, B = valid), kitti/disp_0 and\n"
      "         disp_1/STEM.png (16 bits: 256 times the disparity in pixels, fx * baseline / z, of the pixel now and "
      "of its\n"
      "         point in the next frame; 0 = unknown)\n"
      "\n"
      "pd-flow, sr-flow and layered-flow re-implement the ideas of Jaimez et al. 2015, Quiroga et al. 2014 and Sun et "
      "al.\n"
      "2015, for comparison; they are not their authors' code.\n"
      "\n"
      "Example:  depthtween-core sceneflow recording -o motion\n"
      "Example:  depthtween-core sceneflow recording -o motion --format flo,kitti --json\n");
  command->add_option("sequence", arguments->sequence, "Sequence folder to read")->required()->type_name("SEQ");
  command->add_option("-o,--out", arguments->out, "Folder to write the result to")->required()->type_name("OUT");
  AddThreads(*command, arguments->threads);
  command->add_flag("--json", arguments->json, "Print the report instead of a sentence");
  command->add_flag("--force", arguments->force, "Replace an earlier result in OUT");
  AddOptionFlags(*command, SceneFlowOptionSpecs(), arguments->document);
  command->callback([=] { *exit_code = ReportStatus(RunSceneFlow(*arguments)); });
}

}  // namespace depthtween::tools
