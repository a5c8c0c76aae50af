#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/order.h"
#include "client/cli/submission.h"
#include "core/flags/option_flags.h"
#include "core/options/upsample_options.h"

namespace depthtween::cli {
namespace {

struct SubmitOptions {
  SubmissionOptions submission;
  nlohmann::json document = nlohmann::json::object();
  RenderFlags renders;
  std::string container;
};

absl::StatusOr<v1::Job> Order(const SubmitOptions& options) {
  ASSIGN_OR_RETURN(const std::vector<v1::RenderOptions> renders, RenderMessagesOf(options.renders, options.container));
  ASSIGN_OR_RETURN(v1::Job order, OrderOf(JobKind::kUpsample, options.document));
  for (const v1::RenderOptions& render : renders) *order.add_renders() = render;
  return order;
}

}  // namespace

void AddSubmitCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<SubmitOptions>();
  CLI::App* command = app.add_subcommand(
      "submit", "Upload a recording and queue a job on it. If interrupted, the same command resumes");
  AddSubmissionOptions(*command, options->submission);
  command
      ->add_option("--video", options->container,
                   "Make a video of the pictures of --dof and --stereo: mp4 (H.264) or mkv (FFV1, lossless)")
      ->type_name("NAME")
      ->check(CLI::IsMember({"mp4", "mkv"}));
  AddRenderFlags(*command, options->renders);
  AddOptionFlags(*command, UpsampleOptionSpecs(), options->document);
  command->footer(
      PresetHelp() +
      "\n"
      "With --dof or --stereo the job renders every frame too, as soon as the frames around it are finished; OUT gets\n"
      "their images in dof/ and stereo/.\n"
      "\n"
      "Example:  depthtween submit recording --dof --fstop 1.4 --focus-depth 2.5 --stereo --video mp4 -o result\n");
  command->callback([options, exit_code] { *exit_code = RunSubmission(options->submission, Order(*options)); });
}

}  // namespace depthtween::cli
