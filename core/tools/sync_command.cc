// depthtween-core sync: how far the depth camera's clock is from the colour camera's.
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/capture/register.h"
#include "core/io/file.h"
#include "core/io/sequence_folder.h"
#include "core/sequence/retold_source.h"
#include "core/session/clip_clock.h"
#include "core/session/upsample_run.h"
#include "core/tools/commands.h"
#include "core/tools/progress_bar.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

struct SyncArguments {
  std::string sequence, out;
  SynchroniseOptions options{.threads = AvailableThreads()};
  bool json = false;
};

void SayHowToUse(const ClockEstimate& estimate) {
  std::cout << absl::StrFormat(
      "corrected stamps are right to +-%.2f ms; rows of colour come %.1f us after one another (+-%.1f us)\n",
      1e-6 * estimate.stamp_sigma_ns, 1e-3 * estimate.row_time_ns, 1e-3 * estimate.row_time_sigma_ns);
  std::cout << absl::StrFormat("to use it: --clock estimate, or --clock=%.3f,%.1f\n", 1e-6 * estimate.model.offset_ns,
                               estimate.model.drift_ppm);
}

absl::Status Sync(const SyncArguments& arguments) {
  StopOnSignals signals;
  ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> folder, SequenceFolder::Open(arguments.sequence));
  for (const std::string& warning : folder->Warnings(arguments.options.threads))
    std::cerr << "warning: " << warning << std::endl;
  SynchroniseOptions options = arguments.options;
  options.stop = signals.token();
  ClockEstimate estimate;
  RegistrationEstimate registration;
  {
    CountLine counter("clock: took", "looks at frames");
    options.on_progress = [&](int done, int total) { counter.Show(done, total); };
    ASSIGN_OR_RETURN(estimate, EstimateAnyClock(*folder, options));
    const ClockModel& clock = estimate.model;
    const RetoldSource corrected(*folder, CorrectDepthStamps(folder->sequence(), clock));
    ASSIGN_OR_RETURN(registration, EstimateRegistration(corrected, {.threads = options.threads, .stop = options.stop}));
  }
  nlohmann::json document = ToJson(estimate);
  document["registration"] = ToJson(registration);
  const std::string json = document.dump(2) + "\n";
  if (!arguments.out.empty()) RETURN_IF_ERROR(WriteFile(arguments.out, json));
  if (arguments.json) {
    std::cout << json << std::flush;
    return absl::OkStatus();
  }
  std::cout << Summary(estimate) << "\n";
  if (estimate.reason.empty()) SayHowToUse(estimate);
  std::cout << Summary(registration) << "\n";
  if (registration.IsOff()) std::cout << "to move depth to colour: --register estimate\n";
  return absl::OkStatus();
}

}  // namespace

void AddSyncCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<SyncArguments>();
  CLI::App* const command =
      app.add_subcommand("sync", "Measure from the images how the two cameras' clocks and images differ");
  command->footer(
      "Edges of depth frames are compared with those of colour: at the right time they meet. Tells the offset and the\n"
      "drift of the depth camera's clock, how long the colour camera takes from row to row, and how sure all that is.\n"
      "Stamps may be off by up to two periods of depth. Where nothing moves, nothing can be told of clocks.\n"
      "Also tells by what shift, scale and parallax depth lies beside colour in the image.\n"
      "\n"
      "Example:  depthtween-core sync recording\n"
      "Example:  depthtween-core upsample recording -o result --clock estimate\n");
  command->add_option("sequence", arguments->sequence, "Sequence folder to read")->required()->type_name("SEQ");
  command->add_option("-o,--out", arguments->out, "Also write the estimate as JSON to FILE")->type_name("FILE");
  command->add_flag("--json", arguments->json, "Print JSON instead of sentences");
  command->add_option("--keys", arguments->options.max_keys, "Depth frames to look at, spread over the recording")
      ->capture_default_str()
      ->check(CLI::Range(kMinSynchroniseKeys, 1000000))
      ->type_name("N");
  AddThreads(*command, arguments->options.threads);
  command->callback([=] { *exit_code = ReportStatus(Sync(*arguments)); });
}

}  // namespace depthtween::tools
