#include <map>
#include <memory>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/clock_flag.h"
#include "client/cli/commands.h"
#include "client/cli/render_flags.h"
#include "client/cli/submission.h"

namespace depthtween::cli {
namespace {

using Method = v1::UpsampleOptions::Method;

// As `depthtween-core upsample` names them.
const std::map<std::string, Method> kMethods = {
    {"ours", v1::UpsampleOptions::METHOD_OURS},         {"hold", v1::UpsampleOptions::METHOD_HOLD},
    {"nearest", v1::UpsampleOptions::METHOD_NEAREST},   {"linear", v1::UpsampleOptions::METHOD_LINEAR},
    {"dolson", v1::UpsampleOptions::METHOD_DOLSON},     {"dolson-mode", v1::UpsampleOptions::METHOD_DOLSON_MODE},
    {"tracking", v1::UpsampleOptions::METHOD_TRACKING}, {"flow-warp", v1::UpsampleOptions::METHOD_FLOW_WARP}};
const std::map<std::string, v1::UpsampleOptions::Preset> kPresets = {
    {"fast", v1::UpsampleOptions::PRESET_FAST},
    {"balanced", v1::UpsampleOptions::PRESET_BALANCED},
    {"best", v1::UpsampleOptions::PRESET_BEST},
    {"reference", v1::UpsampleOptions::PRESET_REFERENCE}};

struct SubmitOptions {
  SubmissionOptions submission;
  std::string method = "ours";
  int key_every = 1;
  std::string preset = "balanced";
  std::vector<std::string> without, literal;
  bool self_check = false;
  bool causal = false;
  bool scene_flow = false;
  std::string clock = "stamps";
  RenderFlags renders;
  v1::RenderOptions::Container container = v1::RenderOptions::CONTAINER_UNSPECIFIED;
};

absl::StatusOr<v1::Job> OrderOf(const SubmitOptions& options) {
  ASSIGN_OR_RETURN(const std::vector<v1::RenderOptions> renders, RendersOf(options.renders, options.container));
  // Said before anything is uploaded; the server knows the names.
  if (!options.literal.empty() && options.preset != "reference") {
    return absl::InvalidArgumentError(
        absl::StrCat("--literal is for --preset reference alone, and the preset is ", options.preset));
  }
  v1::Job order;
  order.mutable_options()->set_method(kMethods.at(options.method));
  order.mutable_options()->set_key_every(options.key_every);
  order.mutable_options()->set_preset(kPresets.at(options.preset));
  order.mutable_options()->mutable_without()->Assign(options.without.begin(), options.without.end());
  order.mutable_options()->mutable_literal()->Assign(options.literal.begin(), options.literal.end());
  order.mutable_options()->set_self_check(options.self_check);
  order.mutable_options()->set_causal(options.causal);
  order.mutable_options()->set_scene_flow(options.scene_flow);
  order.mutable_options()->set_clock(options.clock);
  for (const v1::RenderOptions& render : renders) *order.add_renders() = render;
  return order;
}

}  // namespace

void AddSubmitCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<SubmitOptions>();
  CLI::App* command = app.add_subcommand(
      "submit", "Upload a recording and queue a job on it. The same command again goes on where it stopped");
  AddSubmissionOptions(*command, options->submission);
  std::vector<std::string> methods;
  for (const auto& [name, method] : kMethods) methods.push_back(name);
  command
      ->add_option("--method", options->method,
                   "How: ours, hold, nearest, linear, dolson, dolson-mode, tracking, flow-warp")
      ->type_name("NAME")
      ->check(CLI::IsMember(methods))
      ->capture_default_str();
  command->add_option("--key-every", options->key_every, "Use only every N-th depth frame, for leave-out experiments")
      ->type_name("N")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  std::vector<std::string> presets;
  for (const auto& [name, preset] : kPresets) presets.push_back(name);
  command
      ->add_option("--preset", options->preset,
                   "What accuracy may cost, for method ours: fast, balanced, best, reference")
      ->type_name("NAME")
      ->check(CLI::IsMember(presets))
      ->capture_default_str();
  command
      ->add_option(
          "--without", options->without,
          "Leave stages of method ours out, to learn what each is worth: settle, recover, thin, draw, solve, "
          "propagation, median, witnesses, silhouettes; of the solve opti, point, plane, proj, rigid, reg, short, "
          "occlusion, topology; names with commas between them")
      ->delimiter(',')
      ->type_name("NAMES");
  command
      ->add_option("--literal", options->literal,
                   "With preset reference, take choices of the paper as it prints them, to compare with: closest, "
                   "coherence, kernels, occlusion, point, proj, rigid, short, topology; names with commas between them")
      ->delimiter(',')
      ->type_name("NAMES");
  command->add_flag(
      "--causal", options->causal,
      "Take each frame from what had been seen by then alone, for low latency: the last depth frames, and "
      "the colour frames up to it");
  command
      ->add_option("--clock", options->clock,
                   "How depth frames come onto the colour camera's clock: stamps (they are right), index (pair by "
                   "number), estimate (from the images), or OFFSET_MS[,DRIFT_PPM] that the depth clock is ahead and "
                   "gains, such as 4,300 (negative: --clock=-4)")
      ->type_name("CLOCK")
      ->check(ClockProblem)
      ->capture_default_str();
  command->add_flag(
      "--scene-flow", options->scene_flow,
      "Also the 3-D motion of every frame to the next, metres: sceneflow/*.npz, but for frames before the "
      "first and after the last depth frame");
  command->add_flag("--self-check", options->self_check,
                    "First hold out every second depth frame and report how far ours, flow-warp, linear and hold are "
                    "from it on this recording; costs at most what 24 intervals cost");
  AddRenderFlags(*command, options->renders);
  command
      ->add_option_function<std::string>(
          "--video",
          [options](const std::string& name) {
            options->container = name == "mp4" ? v1::RenderOptions::CONTAINER_MP4 : v1::RenderOptions::CONTAINER_MKV;
          },
          "Put the pictures of --dof and --stereo together in the end: mp4 (H.264) or mkv (FFV1, lossless)")
      ->type_name("NAME")
      ->check(CLI::IsMember({"mp4", "mkv"}));
  command->footer(
      "With --dof or --stereo the job renders every frame too, as soon as the frames around it are finished; OUT gets\n"
      "their images in dof/ and stereo/.\n"
      "\n"
      "Example:  depthtween submit recording --dof --fstop 1.4 --focus-depth 2.5 --stereo --video mp4 -o result\n");
  command->callback([options, exit_code] { *exit_code = RunSubmission(options->submission, OrderOf(*options)); });
}

}  // namespace depthtween::cli
