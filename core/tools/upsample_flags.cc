#include "core/tools/upsample_flags.h"

#include "absl/strings/str_join.h"
#include "core/upsample/pipeline.h"

namespace depthtween::tools {

std::vector<CLI::Option*> AddQualityFlags(CLI::App& command, UpsampleOptions& options) {
  const std::string group = "Accuracy and time (method ours)";
  std::vector<CLI::Option*> added;
  added.push_back(command.add_option("--preset", options.preset, "What accuracy may cost: see below")
                      ->capture_default_str()
                      ->check(CLI::IsMember(PresetNames()))
                      ->type_name(absl::StrJoin(PresetNames(), "|"))
                      ->group(group));
  added.push_back(command
                      .add_option("--without", options.without,
                                  "Leave stages out, to learn what each is worth: names with commas between them, of " +
                                      absl::StrJoin(PartNames(), ", "))
                      ->delimiter(',')
                      ->check(CLI::IsMember(PartNames()))
                      ->type_name("NAMES")
                      ->group(group));
  added.push_back(
      command
          .add_option("--literal", options.literal,
                      "With preset reference, take choices of the paper as it prints them, to compare with: "
                      "names with commas between them, of " +
                          absl::StrJoin(LiteralNames(), ", "))
          ->delimiter(',')
          ->check(CLI::IsMember(LiteralNames()))
          ->type_name("NAMES")
          ->group(group));
  added.push_back(
      command
          .add_flag("--causal", options.causal,
                    "Take each frame from what had been seen by then alone, for low latency: the last depth "
                    "frames, and the colour frames up to it")
          ->group(group));
  added.push_back(
      command
          .add_flag("--self-check", options.self_check,
                    "First hold out every second depth frame and report how far ours, flow-warp, linear and hold are "
                    "from it on this recording; costs at most what 24 intervals cost")
          ->group(group));
  return added;
}

std::string PresetHelp() {
  return "Presets, from the fastest on:\n"
         "  fast      motion at half resolution and fewer proposals: a first look; edges of moving things suffer\n"
         "  balanced  the default\n"
         "  best      searches longer where frames are hard to match: takes longer, gains 0 to 2 % at edges\n"
         "  reference as best, and the depth maps' surfaces move by the paper's joint optimisation, in its schedule: "
         "to\n"
         "            compare with; takes several times as long as best and gains little\n";
}

}  // namespace depthtween::tools
