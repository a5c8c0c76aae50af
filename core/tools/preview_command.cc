#include <iostream>
#include <memory>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "core/session/preview.h"
#include "core/tools/commands.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

struct PreviewArguments {
  std::string result, file, sequence;
  int frame = -1;
};

absl::Status Preview(const PreviewArguments& arguments) {
  StopOnSignals signals;
  const bool is_video = absl::EndsWithIgnoreCase(arguments.file, ".mp4");
  if (!is_video && !absl::EndsWithIgnoreCase(arguments.file, ".png"))
    return absl::InvalidArgumentError(absl::StrFormat("-o %s: must end in .png or .mp4", arguments.file));
  if (is_video && arguments.frame >= 0)
    return absl::InvalidArgumentError("--frame chooses what a .png shows; a .mp4 shows every frame");
  ASSIGN_OR_RETURN(const FinishedClip clip, OpenFinishedClip(arguments.result, arguments.sequence));
  if (arguments.frame >= clip.frame_count())
    return absl::InvalidArgumentError(
        absl::StrFormat("--frame %d: the clip has frames 0 to %d", arguments.frame, clip.frame_count() - 1));
  ASSIGN_OR_RETURN(const std::string shown, is_video ? WritePreviewVideo(clip, arguments.file, signals.token())
                                                     : WritePreviewSheet(clip, arguments.frame, arguments.file));
  std::cout << arguments.file << ": " << shown << "\n";
  return absl::OkStatus();
}

}  // namespace

void AddPreviewCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<PreviewArguments>();
  CLI::App* const command = app.add_subcommand("preview", "Show a result: colour, depth and uncertainty side by side");
  command->footer(
      "A .png shows frames from one depth frame to the next; a .mp4 shows every frame, at 30 per second.\n"
      "A colour stands for the same distance in the whole clip.\n"
      "\n"
      "Example:  depthtween-core preview result -o result.png\n"
      "Example:  depthtween-core preview result -o result.mp4\n");
  command->add_option("result", arguments->result, "Folder that upsample wrote")->required()->type_name("OUT");
  command->add_option("-o,--out", arguments->file, "Picture (.png) or video (.mp4) to write")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--sequence", arguments->sequence,
                   "The recording, if it is no longer where upsample read it, or if a server did")
      ->type_name("SEQ");
  command->add_option("--frame", arguments->frame, "Show the interval with this frame [the middle one]")
      ->check(CLI::NonNegativeNumber)
      ->type_name("N");
  command->callback([=] { *exit_code = ReportStatus(Preview(*arguments)); });
}

}  // namespace depthtween::tools
