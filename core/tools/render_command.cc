#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/flags/option_flags.h"
#include "core/flags/render_flags.h"
#include "core/session/render_run.h"
#include "core/tools/commands.h"
#include "core/tools/progress_bar.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

using nlohmann::json;

constexpr char kFooter[] =
    "SEQ is a recording, which is upsampled first, or a folder that `upsample --keep-motion` wrote.\n"
    "OUT decides what is written: .mp4 (H.264, plays everywhere), .mkv (FFV1, loses nothing), or else a folder of\n"
    "images named as the colour frames. Videos of two eyes get the ending that players know them by, such as\n"
    "_LRF_Full_SBS.\n"
    "\n"
    "The lens is a virtual one in front of the colour camera. Its aperture is focal length / f-stop wide, and that\n"
    "alone is what it decides: the field of view stays the colour camera's. Without --focal-mm it is the focal length\n"
    "that has that field of view on the sensor named by --sensor. A smaller f-stop, a longer focal length, a larger\n"
    "sensor or a nearer focus give more blur.\n"
    "\n"
    "Example:  depthtween-core render recording --dof --fstop 1.4 --focus-depth 2.5 -o blurred.mp4\n"
    "Example:  depthtween-core render result --dof --focus-track 0,320,240 -o followed.mp4\n"
    "Example:  depthtween-core render result --dof --focus-keys 0:1.2,60:4 -o rack.mkv\n"
    "Example:  depthtween-core render result --stereo --format full-sbs -o pair.mp4\n"
    "Example:  depthtween-core render result --stereo --format anaglyph-dubois -o glasses\n";

struct RenderArguments {
  std::string input, out, sequence;
  RenderFlags flags;
  int threads = AvailableThreads();
  json upsample = json::object();  // of a recording
  std::vector<CLI::Option*> upsample_flags;
  bool force = false;
};

// "mp4" or "mkv" of a video, or nothing of a folder.
std::string ContainerOf(const std::string& out) {
  if (absl::EndsWithIgnoreCase(out, ".mp4")) return "mp4";
  return absl::EndsWithIgnoreCase(out, ".mkv") ? "mkv" : "";
}

absl::Status Render(const RenderArguments& arguments) {
  StopOnSignals signals;
  ASSIGN_OR_RETURN(const std::vector<json> renders, RendersOf(arguments.flags, ContainerOf(arguments.out)));
  if (renders.size() != 1) return absl::InvalidArgumentError("say what to render: one of --dof and --stereo");
  ASSIGN_OR_RETURN(const RenderOptions options, ParseRender(renders[0], "options"));
  ASSIGN_OR_RETURN(UpsampleOptions upsample, ParseUpsampleOptions(arguments.upsample));
  upsample.threads = arguments.threads;
  for (const CLI::Option* flag : arguments.upsample_flags)
    if (flag->count() > 0 && !IsRecording(arguments.input))
      return absl::InvalidArgumentError(
          absl::StrCat(flag->get_name(), " is about upsampling, and ", arguments.input, " is upsampled already"));
  ASSIGN_OR_RETURN(const ClipRendered rendered,
                   RenderClip({.input = arguments.input,
                               .sequence = arguments.sequence,
                               .out = arguments.out,
                               .options = options,
                               .upsample = upsample,
                               .force = arguments.force,
                               .self_check =
                                   [&](const SequenceFolder& recording) {
                                     return CheckSelfAloud(recording, upsample, signals.token());
                                   },
                               .observe =
                                   [](const ClipPlan& plan) {
                                     for (const std::string& warning : plan.constants.warnings)
                                       std::cerr << "warning: " << warning << std::endl;
                                     return std::make_unique<ProgressBar>(plan);
                                   }},
                              signals.token()));
  std::cout << absl::StrFormat("%d frames in %.1f s (%.1f frames per second)", rendered.frames, rendered.seconds,
                               rendered.frames / rendered.seconds);
  if (!rendered.encoder.empty())
    std::cout << absl::StrFormat(", shown at %.6g per second%s, %s", rendered.video_fps,
                                 rendered.rate_changes ? " on average, each at its stamp" : "", rendered.encoder);
  for (const std::string& file : rendered.files) std::cout << "\n" << file;
  std::cout << "\n" << rendered.report << std::endl;
  return absl::OkStatus();
}

}  // namespace

void AddRenderCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<RenderArguments>();
  CLI::App* const command = app.add_subcommand("render", "Make pictures of depth: depth of field, or a second eye");
  command->footer(kFooter + ("\n" + PresetHelp()));
  command->add_option("input", arguments->input, "Recording, or folder that upsample wrote")
      ->required()
      ->type_name("SEQ");
  command->add_option("-o,--out", arguments->out, "Video (.mp4, .mkv) or folder to write")
      ->required()
      ->type_name("OUT");
  command
      ->add_option("--sequence", arguments->sequence,
                   "The recording, if it is no longer where upsample read it, or if a server did")
      ->type_name("SEQ");
  AddThreads(*command, arguments->threads);
  command->add_flag("--force", arguments->force, "Replace what is at OUT");
  AddRenderFlags(*command, arguments->flags);
  arguments->upsample_flags =
      AddOptionFlags(*command, UpsampleOptionSpecs(), arguments->upsample,
                     {"preset", "causal", "self_check", "fill", "clock", "register", "without", "literal"});
  command->callback([=] { *exit_code = ReportStatus(Render(*arguments)); });
}

}  // namespace depthtween::tools
