// depthtween-core synth: a recording of a rendered scene, with all truth.
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/session/clear_output.h"
#include "core/synthetic/synthetic_sequence.h"
#include "core/tools/commands.h"
#include "core/tools/picture_size.h"
#include "core/tools/progress_bar.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

struct SynthArguments {
  SyntheticOptions options;
  std::string out, size = "512x424", noise = "kinect2";
  double depth_phase_ms = 0.0, time_offset_ms = 0.0;
  int threads = AvailableThreads();
  bool no_truth = false, force = false;
};

// The options as the library takes them. Everything wrong with them is said here, before anything is touched.
absl::StatusOr<SyntheticOptions> ReadOptions(const SynthArguments& arguments) {
  SyntheticOptions options = arguments.options;
  RETURN_IF_ERROR(ParsePictureSize(arguments.size, options.width, options.height));
  ASSIGN_OR_RETURN(options.sensor, SensorByName(arguments.noise));
  options.depth_phase_s = 1e-3 * arguments.depth_phase_ms;
  options.depth_clock.offset_s = 1e-3 * arguments.time_offset_ms;
  RETURN_IF_ERROR(SyntheticSequence::Create(options).status());
  return options;
}

absl::Status Synth(const SynthArguments& arguments, const SyntheticOptions& options) {
  StopOnSignals signals;
  RETURN_IF_ERROR(
      ClearOutput(arguments.out, arguments.force, "the recording",
                  {"rgb.txt", "depth.txt", "depth_clean.txt", "camera.json", "rgb", "depth", "depth_clean", "gt"}));

  int frames = 0;
  {
    CountLine counter("rendered", "frames");
    RETURN_IF_ERROR(WriteSyntheticSequence(options, arguments.out,
                                           {.truth = !arguments.no_truth,
                                            .threads = arguments.threads,
                                            .stop = signals.token(),
                                            .on_progress = [&](int done, int total) {
                                              frames = total;
                                              counter.Show(done, total);
                                            }}));
  }
  std::cout << absl::StrFormat("%s: %d colour frames at %g fps and %d depth frames at %g fps, %dx%d%s\n", arguments.out,
                               options.frames, options.color_fps, frames - options.frames, options.depth_fps,
                               options.width, options.height, arguments.no_truth ? "" : ", with truth in gt/");
  return absl::OkStatus();
}

}  // namespace

void AddSynthCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<SynthArguments>();
  SyntheticOptions& options = arguments->options;
  CLI::App* const command = app.add_subcommand("synth", "Render a recording of a scene, with exact truth");
  std::vector<std::string> names;
  std::string footer = "Scenes:\n";
  for (const SceneInfo& scene : SceneList()) {
    names.emplace_back(scene.name);
    absl::StrAppendFormat(&footer, "  %-10s %s\n", std::string(scene.name), std::string(scene.phrase));
  }
  absl::StrAppend(
      &footer,
      "\n"
      "SEQ gets rgb/ and depth/ as two cameras record them, depth_clean/ without noise, and gt/ with exact\n"
      "depth, flow, scene flow, occlusion and objects.\n"
      "\n"
      "Example:  depthtween-core synth kick -o kick\n"
      "Example:  depthtween-core synth pan -o pan --frames 65 --noise none --size 256x212\n");
  command->footer(footer);
  command->add_option("scene", options.scene, "Which scene to render")
      ->required()
      ->check(CLI::IsMember(names))
      ->type_name("SCENE");
  command->add_option("-o,--out", arguments->out, "Folder to write the recording to")->required()->type_name("SEQ");
  command->add_option("--frames", options.frames, "Colour frames")->capture_default_str()->type_name("N");
  command->add_option("--color-fps", options.color_fps, "Colour frames per second")
      ->capture_default_str()
      ->type_name("FPS");
  command->add_option("--depth-fps", options.depth_fps, "Depth frames per second; the ratio need not be whole")
      ->capture_default_str()
      ->type_name("FPS");
  command->add_option("--size", arguments->size, "Width and height in pixels")->capture_default_str()->type_name("WxH");
  command->add_option("--noise", arguments->noise, "Which sensor: kinect2, or none for perfect frames")
      ->capture_default_str()
      ->check(CLI::IsMember({"kinect2", "none"}))
      ->type_name("NAME");
  command->add_option("--seed", options.seed, "Of textures, clutter and noise")->capture_default_str()->type_name("S");
  command
      ->add_option("--depth-phase-ms", arguments->depth_phase_ms, "First depth frame this long after the first colour")
      ->capture_default_str()
      ->type_name("MS");
  command
      ->add_option("--time-offset-ms", arguments->time_offset_ms,
                   "What the depth camera's clock shows when the colour camera's shows 0")
      ->capture_default_str()
      ->type_name("MS");
  command
      ->add_option("--drift-ppm", options.depth_clock.drift_ppm,
                   "Microseconds a second that the depth camera's clock gains")
      ->capture_default_str()
      ->type_name("PPM");
  AddThreads(*command, arguments->threads, "Threads to use; the files do not depend on it");
  command->add_flag("--no-truth", arguments->no_truth, "Only what the cameras record: no gt/, no depth_clean/");
  command->add_flag("--force", arguments->force, "Replace the recording in SEQ");
  command->callback([=] {
    const absl::StatusOr<SyntheticOptions> read = ReadOptions(*arguments);
    if (!read.ok()) {
      ReportStatus(read.status());
      *exit_code = kExitUsage;
      return;
    }
    *exit_code = ReportStatus(Synth(*arguments, *read));
  });
}

}  // namespace depthtween::tools
