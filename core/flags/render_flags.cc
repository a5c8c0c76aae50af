#include "core/flags/render_flags.h"

#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "core/flags/option_flags.h"
#include "core/options/render_option_list.h"

namespace depthtween {
namespace {

using nlohmann::json;

constexpr char kLens[] = "Depth of field";
constexpr char kEyes[] = "Stereo";

// JSON has no infinity and no NaN.
bool ReadNumber(absl::string_view text, double* number) {
  return absl::SimpleAtod(text, number) && std::isfinite(*number);
}

json ParseDepth(const std::string& flag, const std::string& text) {
  double depth_m = 0;
  if (!ReadNumber(text, &depth_m)) throw CLI::ValidationError(flag, "must be a number of metres");
  return {{"depth_m", depth_m}};
}

json ParsePixel(const std::string& flag, const std::string& text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  int frame = 0;
  double x = 0, y = 0;
  if (parts.size() != 3 || !absl::SimpleAtoi(parts[0], &frame) || !ReadNumber(parts[1], &x) ||
      !ReadNumber(parts[2], &y))
    throw CLI::ValidationError(flag, "must be FRAME,X,Y such as 0,320,240");
  return {{"frame", frame}, {"x", x}, {"y", y}};
}

json ParseKeys(const std::string& flag, const std::string& text) {
  json keys = json::array();
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const std::vector<std::string> sides = absl::StrSplit(part, ':');
    int frame = 0;
    double depth_m = 0;
    if (sides.size() != 2 || !absl::SimpleAtoi(sides[0], &frame) || !ReadNumber(sides[1], &depth_m))
      throw CLI::ValidationError(flag, "must be FRAME:METRES,FRAME:METRES... such as 0:1.2,60:4");
    keys.push_back({{"frame", frame}, {"depth_m", depth_m}});
  }
  return {{"keys", std::move(keys)}};
}

void AddFocusFlags(CLI::App& command, json& dof) {
  const auto add = [&](const std::string& flag, const char* type, const char* help,
                       const std::function<json(const std::string& text)>& parse) {
    command
        .add_option_function<std::string>(
            flag, [&dof, parse](const std::string& text) { dof["focus"].update(parse(text), /*merge_objects=*/true); },
            help)
        ->type_name(type)
        ->group(kLens);
  };
  const auto inside = [](const char* field, const std::string& flag,
                         json (*parse)(const std::string&, const std::string&)) {
    return [=](const std::string& text) { return json{{field, parse(flag, text)}}; };
  };
  add("--focus-depth", "M", "Focus at this depth, metres [the clip's median]",
      [](const std::string& text) { return ParseDepth("--focus-depth", text); });
  add("--focus-pixel", "FRAME,X,Y", "Focus at what this frame shows there, in all frames",
      inside("pixel", "--focus-pixel", ParsePixel));
  add("--focus-track", "FRAME,X,Y", "Focus on what this frame shows there, wherever it moves",
      inside("track", "--focus-track", ParsePixel));
  add("--focus-keys", "FRAME:M,...", "Focus from depth to depth (rack focus)",
      inside("keys", "--focus-keys", ParseKeys));
  command
      .add_option_function<std::string>(
          "--focus-easing", [&dof](const std::string& easing) { dof["focus"]["keys"]["easing"] = easing; },
          "Between keys [smooth]: " + absl::StrJoin(FocusEasingWords(), ", "))
      ->check(CLI::IsMember(FocusEasingWords()))
      ->type_name("NAME")
      ->group(kLens);
}

}  // namespace

void AddRenderFlags(CLI::App& command, RenderFlags& flags) {
  command.add_flag("--dof", flags.dof, "Blur what is not in focus, as a virtual lens before the camera would")
      ->group(kLens);
  AddOptionFlags(command, DepthOfFieldOptionSpecs(), flags.dof_options);
  AddFocusFlags(command, flags.dof_options);

  command.add_flag("--stereo", flags.stereo, "Make a second eye")->group(kEyes);
  json& stereo = flags.stereo_options;
  AddOptionFlags(command, StereoOptionSpecs(), stereo);
  command
      .add_flag_callback(
          "--no-floating-window", [&stereo] { stereo["floating_window"] = false; },
          "No black borders before what the frame cuts")
      ->group(kEyes);
  command
      .add_flag_callback(
          "--metadata", [&stereo] { stereo["metadata"] = true; },
          "Mark videos so that a stereo display switches by itself")
      ->group(kEyes);
  command
      .add_option("--frames", flags.frame_format,
                  "How pictures are stored [png]: " + absl::StrJoin(FrameFormatWords(), ", "))
      ->check(CLI::IsMember(FrameFormatWords()))
      ->type_name("FORMAT");
}

absl::StatusOr<std::vector<json>> RendersOf(const RenderFlags& flags, const std::string& container) {
  if (!flags.dof && !flags.dof_options.empty())
    return absl::InvalidArgumentError("lens and focus are for --dof, which was not given");
  if (!flags.stereo && !flags.stereo_options.empty())
    return absl::InvalidArgumentError("baseline, format and the like are for --stereo, which was not given");
  // A message holds one focus: of two, one would be lost without a word.
  if (flags.dof_options.contains("focus") && flags.dof_options["focus"].size() > 1)
    return absl::InvalidArgumentError(
        "give one focus: one of --focus-depth, --focus-pixel, --focus-track and --focus-keys (--focus-easing is for "
        "--focus-keys)");
  std::vector<json> renders;
  if (flags.dof) renders.push_back({{"depth_of_field", flags.dof_options}});
  if (flags.stereo) renders.push_back({{"stereo", flags.stereo_options}});
  for (json& render : renders) {
    if (!flags.frame_format.empty()) render["frame_format"] = flags.frame_format;
    if (!container.empty()) render["container"] = container;
  }
  return renders;
}

}  // namespace depthtween
