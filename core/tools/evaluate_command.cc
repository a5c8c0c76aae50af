// depthtween-core evaluate: how good a result is, beside the baselines.
#include <iostream>
#include <memory>
#include <string>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "core/base/parallel.h"
#include "core/baselines/baselines.h"
#include "core/session/evaluation.h"
#include "core/tools/commands.h"
#include "core/tools/progress_bar.h"

namespace depthtween::tools {
namespace {

constexpr char kAllBaselines[] = "all";
constexpr char kQuickBaselines[] = "quick";

struct EvaluateArguments {
  EvaluationOptions options;
  std::string baselines;  // as written: "all" or names with commas between them
  bool json = false;
  int worst_frames = 0;
};

absl::Status RunEvaluate(const EvaluateArguments& arguments) {
  EvaluationOptions options = arguments.options;
  if (arguments.baselines == kQuickBaselines)
    options.baselines = QuickBaselineNames();
  else if (arguments.baselines == kAllBaselines)
    options.baselines = BaselineNames();
  else if (!arguments.baselines.empty())
    options.baselines = absl::StrSplit(arguments.baselines, ',');
  CountLine counter("scored", "frames");
  options.on_progress = [&](int done, int total) { counter.Show(done, total); };
  ASSIGN_OR_RETURN(const Evaluation evaluation, Evaluate(options));
  if (arguments.json)
    std::cout << ToJson(evaluation).dump(2) << std::endl;
  else
    std::cout << FormatTable(evaluation, arguments.worst_frames) << std::flush;
  return absl::OkStatus();
}

}  // namespace

void AddEvaluateCommand(CLI::App& app, int* exit_code) {
  CLI::App* command = app.add_subcommand("evaluate", "Measures a result against truth, beside the baselines");
  const auto arguments = std::make_shared<EvaluateArguments>();
  EvaluationOptions& options = arguments->options;
  options.threads = AvailableThreads();
  command->add_option("OUT", options.result_dir, "The folder that upsample wrote")->required();
  command
      ->add_option("--reference", options.reference_dir,
                   "The sequence OUT was made from. Truth is its gt/depth or, without that, its left-out depth maps")
      ->required();
  command
      ->add_option("--baselines", arguments->baselines,
                   "Also compute these on the same inputs: names with commas between them of " +
                       absl::StrJoin(BaselineNames(), ", ") +
                       "; 'all' of them (dolson and dolson-mode take seconds a frame, tracking an interval); no name: "
                       "the quick ones")
      ->expected(0, 1)
      ->default_str(kQuickBaselines)
      ->type_name("[NAMES]");
  command->add_option("--far", options.far_m, "Score truth up to this distance")
      ->capture_default_str()
      ->check(CLI::PositiveNumber)
      ->type_name("METRES");
  command->add_flag("--json", arguments->json, "Print all scores and curves as JSON");
  command->add_option("--worst", arguments->worst_frames, "Also list the N frames of largest RMSE")
      ->type_name("N")
      ->check(CLI::NonNegativeNumber);
  AddThreads(*command, options.threads, "Threads; the numbers do not depend on it");
  command->callback([arguments, exit_code] { *exit_code = ReportStatus(RunEvaluate(*arguments)); });
}

}  // namespace depthtween::tools
