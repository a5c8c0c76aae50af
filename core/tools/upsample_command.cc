#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "absl/strings/str_format.h"
#include "core/api/make_upsampler.h"
#include "core/base/parallel.h"
#include "core/flags/option_flags.h"
#include "core/io/sequence_folder.h"
#include "core/options/upsample_options.h"
#include "core/session/clear_output.h"
#include "core/session/self_check.h"
#include "core/session/upsample_run.h"
#include "core/tools/commands.h"
#include "core/tools/progress_bar.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

namespace fs = std::filesystem;

struct UpsampleArguments {
  std::string sequence, out;
  nlohmann::json document = nlohmann::json::object();
  int threads = AvailableThreads();
  bool keep_motion = false, force = false;
};

absl::Status Upsample(const UpsampleArguments& arguments) {
  StopOnSignals signals;
  ASSIGN_OR_RETURN(UpsampleOptions options, ParseUpsampleOptions(arguments.document));
  options.threads = arguments.threads;
  options.keep_motion = arguments.keep_motion;
  ASSIGN_OR_RETURN(const std::unique_ptr<Upsampler> upsampler, MakeUpsampler(options));
  ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> folder, SequenceFolder::Open(arguments.sequence));
  RETURN_IF_ERROR(ClearResult(
      arguments.out, arguments.force,
      {"report.json", "depth.txt", "camera.json", "depth", "uncertainty", "provenance", "motion", "sceneflow"}));
  ClipPlan plan;
  {
    CountLine counter("clock: took", "looks at frames");
    ASSIGN_OR_RETURN(
        plan, PrepareClip(*folder, options, signals.token(), [&](int done, int total) { counter.Show(done, total); }));
  }
  if (plan.alignment.clock.estimate.has_value() && plan.alignment.clock.estimate->reason.empty())
    std::cout << "clock: " << Summary(*plan.alignment.clock.estimate) << std::endl;
  const ClipSource source(*folder, plan.alignment, options.key_every);
  ASSIGN_OR_RETURN(const ResultWriter writer,
                   ResultWriter::Create(arguments.out, source.sequence(), options.NeedsMotion()));
  for (const std::string& warning : plan.constants.warnings) std::cerr << "warning: " << warning << std::endl;

  ASSIGN_OR_RETURN(nlohmann::json self_check, CheckSelfAloud(*folder, options, signals.token()));

  std::vector<IntervalReport> reports;
  {
    ProgressBar progress(plan);
    auto ran = RunIntervals(*upsampler, source, plan, 0, static_cast<int>(plan.intervals.size()), options,
                            signals.token(), writer, progress);
    if (absl::IsCancelled(ran.status()))
      return absl::CancelledError(absl::StrFormat(
          "stopped; the frames in %s are whole, but it is no finished result (run again with --force)", arguments.out));
    ASSIGN_OR_RETURN(reports, std::move(ran));
  }
  const std::string sequence_dir = fs::absolute(arguments.sequence).lexically_normal().string();
  std::optional<CountLine> scene_flow;
  const auto on_scene_flow = [&](int done, int total) {
    if (!scene_flow) scene_flow.emplace("made", "frames of scene flow");
    scene_flow->Show(done, total);
  };
  RETURN_IF_ERROR(AssembleResult(options, sequence_dir, source.sequence(), plan, reports, nlohmann::json::array(),
                                 std::move(self_check), writer,
                                 {.stop = signals.token(), .on_scene_flow = on_scene_flow}));
  scene_flow.reset();

  double seconds = 0.0;
  for (const IntervalReport& report : reports) seconds += report.seconds;
  const size_t frames = source.sequence().color.size();
  std::cout << absl::StrFormat("%d frames from %d depth frames in %.1f s (%.1f frames per second): %s\n", frames,
                               source.sequence().depth.size(), seconds, static_cast<double>(frames) / seconds,
                               arguments.out);
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<nlohmann::json> CheckSelfAloud(const SequenceFolder& recording, const UpsampleOptions& options,
                                              std::stop_token stop) {
  if (!options.self_check) return nlohmann::json();
  SelfCheck check;
  {
    CountLine counter("checked", "held-out depth maps");
    ASSIGN_OR_RETURN(
        check, CheckSelf(recording, options, std::move(stop), [&](int done, int total) { counter.Show(done, total); }));
  }
  std::cout << FormatTable(check) << std::endl;
  return ToJson(check);
}

void AddUpsampleCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<UpsampleArguments>();
  CLI::App* const command = app.add_subcommand("upsample", "Compute depth for every colour frame of a recording");
  command->footer(
      "OUT gets depth/, uncertainty/ and provenance/ PNGs named as the colour frames, depth.txt, camera.json and\n"
      "report.json.\n"
      "\n" +
      PresetHelp() +
      "\n"
      "Example:  depthtween-core upsample recording -o result\n"
      "Example:  depthtween-core upsample recording -o look --preset fast\n"
      "Example:  depthtween-core upsample recording -o result --self-check\n"
      "Example:  depthtween-core upsample recording -o result --key-every 4    (then evaluate against the rest)\n");
  command->add_option("sequence", arguments->sequence, "Sequence folder to read")->required()->type_name("SEQ");
  command->add_option("-o,--out", arguments->out, "Folder to write the result to")->required()->type_name("OUT");
  AddThreads(*command, arguments->threads);
  command->add_flag(
      "--keep-motion", arguments->keep_motion,
      "Keep the motion between frames too (motion/*.npz): `render` then looks behind edges in other frames");
  command->add_flag("--force", arguments->force, "Replace an earlier result in OUT");
  AddOptionFlags(*command, UpsampleOptionSpecs(), arguments->document);
  command->callback([=] { *exit_code = ReportStatus(Upsample(*arguments)); });
}

}  // namespace depthtween::tools
