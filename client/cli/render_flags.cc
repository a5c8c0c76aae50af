#include "client/cli/render_flags.h"

#include <google/protobuf/descriptor.h>

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

namespace depthtween::cli {
namespace {

constexpr char kLens[] = "Depth of field";
constexpr char kEyes[] = "Stereo";

// The words for an enumeration: "full-sbs" for FORMAT_FULL_SBS, with the prefix "FORMAT_".
std::map<std::string, int> WordsOf(const google::protobuf::EnumDescriptor* type, const std::string& prefix) {
  std::map<std::string, int> words;
  for (int i = 1; i < type->value_count(); ++i) {  // 0 stands for the default
    const std::string word = type->value(i)->name().substr(prefix.size());
    words[absl::AsciiStrToLower(absl::StrReplaceAll(word, {{"_", "-"}}))] = type->value(i)->number();
  }
  return words;
}

template <typename Enum>
void AddWord(CLI::App& command, const char* flag, const std::string& prefix, const char* group,
             std::function<void(Enum)> set, const std::string& help) {
  const std::map<std::string, int> words = WordsOf(google::protobuf::GetEnumDescriptor<Enum>(), prefix);
  const std::string known =
      absl::StrJoin(words, ", ", [](std::string* text, const auto& word) { absl::StrAppend(text, word.first); });
  command
      .add_option_function<std::string>(
          flag,
          [=](const std::string& text) {
            const auto word = words.find(text);
            if (word == words.end()) throw CLI::ValidationError(flag, absl::StrCat("must be one of: ", known));
            set(static_cast<Enum>(word->second));
          },
          absl::StrCat(help, ": ", known))
      ->type_name("NAME")
      ->group(group);
}

template <typename T>
void AddValue(CLI::App& command, const char* flag, const char* unit, const char* group, std::function<void(T)> set,
              const char* help) {
  command
      .add_option_function<T>(
          flag, [set](const T& value) { set(value); }, help)
      ->type_name(unit)
      ->group(group);
}

void AddNumber(CLI::App& command, const char* flag, const char* unit, const char* group,
               std::function<void(double)> set, const char* help) {
  AddValue<double>(command, flag, unit, group, std::move(set), help);
}

v1::Focus::Pixel ParsePixel(const std::string& flag, const std::string& text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  int frame = 0;
  double x = 0, y = 0;
  if (parts.size() != 3 || !absl::SimpleAtoi(parts[0], &frame) || !absl::SimpleAtod(parts[1], &x) ||
      !absl::SimpleAtod(parts[2], &y)) {
    throw CLI::ValidationError(flag, "must be FRAME,X,Y such as 0,320,240");
  }
  v1::Focus::Pixel pixel;
  pixel.set_frame(frame);
  pixel.set_x(x);
  pixel.set_y(y);
  return pixel;
}

void ParseKeys(const std::string& text, v1::Focus::Keys& keys) {
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const std::vector<std::string> sides = absl::StrSplit(part, ':');
    int frame = 0;
    double depth_m = 0;
    if (sides.size() != 2 || !absl::SimpleAtoi(sides[0], &frame) || !absl::SimpleAtod(sides[1], &depth_m)) {
      throw CLI::ValidationError("--focus-keys", "must be FRAME:METRES,FRAME:METRES... such as 0:1.2,60:4");
    }
    v1::Focus::Key* key = keys.add_keys();
    key->set_frame(frame);
    key->set_depth_m(depth_m);
  }
}

}  // namespace

void AddRenderFlags(CLI::App& command, RenderFlags& flags) {
  v1::DepthOfField& dof = flags.dof_options;
  command.add_flag("--dof", flags.dof, "Blur what is not in focus, as a virtual lens before the camera would")
      ->group(kLens);
  AddNumber(
      command, "--fstop", "N", kLens, [&dof](double value) { dof.set_fstop(value); },
      "Aperture = focal length / this; smaller is more blur [1.8]");
  AddNumber(
      command, "--focal-mm", "MM", kLens, [&dof](double value) { dof.set_focal_mm(value); },
      "Focal length; the field of view stays the camera's [that of this field of view on the sensor]");
  command
      .add_option_function<std::string>(
          "--sensor", [&dof](const std::string& name) { dof.set_sensor(name); },
          "full-frame [default], medium-format, super-35, aps-c, micro-four-thirds, one-inch")
      ->type_name("NAME")
      ->group(kLens);
  AddNumber(
      command, "--aperture-mm", "MM", kLens, [&dof](double value) { dof.set_aperture_mm(value); },
      "Diameter of the aperture, instead of --fstop");
  AddNumber(
      command, "--focus-depth", "M", kLens, [&dof](double value) { dof.mutable_focus()->set_depth_m(value); },
      "Focus at this depth, metres [the clip's median]");
  for (const bool track : {false, true}) {
    const std::string flag = track ? "--focus-track" : "--focus-pixel";
    command
        .add_option_function<std::string>(
            flag,
            [&dof, track, flag](const std::string& text) {
              v1::Focus& focus = *dof.mutable_focus();
              *(track ? focus.mutable_track() : focus.mutable_pixel()) = ParsePixel(flag, text);
            },
            track ? "Focus on what this frame shows there, wherever it moves"
                  : "Focus at what this frame shows there, in all frames")
        ->type_name("FRAME,X,Y")
        ->group(kLens);
  }
  command
      .add_option_function<std::string>(
          "--focus-keys", [&dof](const std::string& text) { ParseKeys(text, *dof.mutable_focus()->mutable_keys()); },
          "Focus from depth to depth (rack focus)")
      ->type_name("FRAME:M,...")
      ->group(kLens);
  AddWord<v1::Focus::Keys::Easing>(
      command, "--focus-easing", "EASING_", kLens,
      [&dof](auto easing) { dof.mutable_focus()->mutable_keys()->set_easing(easing); }, "Between keys [smooth]");
  AddWord<v1::DepthOfField::Method>(
      command, "--dof-method", "METHOD_", kLens, [&dof](auto method) { dof.set_method(method); }, "How [layers]");
  AddValue<int>(
      command, "--layers", "N", kLens, [&dof](int value) { dof.set_layers(value); },
      "Layers of equal width in blur [20]");
  AddValue<int>(
      command, "--blades", "N", kLens, [&dof](int value) { dof.set_blades(value); },
      "Of the aperture, 3 to 16; 0 is round [0]");
  AddNumber(
      command, "--max-radius", "PX", kLens, [&dof](double value) { dof.set_max_radius_px(value); },
      "Largest radius of blur, pixels, up to 128 [32]");

  v1::Stereo& stereo = flags.stereo_options;
  command.add_flag("--stereo", flags.stereo, "Make a second eye")->group(kEyes);
  AddWord<v1::Stereo::Format>(
      command, "--format", "FORMAT_", kEyes, [&stereo](auto format) { stereo.set_format(format); },
      "Both eyes in one picture [full-sbs]");
  AddWord<v1::Stereo::Eye>(
      command, "--eye", "EYE_", kEyes, [&stereo](auto eye) { stereo.set_made(eye); }, "The eye that is made [left]");
  AddNumber(
      command, "--divergence", "PERCENT", kEyes, [&stereo](double v) { stereo.set_divergence_percent(v); },
      "Disparity from the nearest to the farthest of the clip, percent of the width [2]");
  AddNumber(
      command, "--baseline", "M", kEyes, [&stereo](double value) { stereo.set_baseline_m(value); },
      "Distance between the eyes, instead of --divergence");
  AddNumber(
      command, "--convergence", "M", kEyes, [&stereo](double value) { stereo.set_convergence_m(value); },
      "Depth that appears on the screen [by the clip]");
  command
      .add_flag_callback(
          "--no-floating-window", [&stereo] { stereo.set_floating_window(false); },
          "No black borders before what the frame cuts")
      ->group(kEyes);
  command
      .add_flag_callback(
          "--metadata", [&stereo] { stereo.set_metadata(true); },
          "Mark videos so that a stereo display switches itself")
      ->group(kEyes);
  AddNumber(
      command, "--screen-width", "M", kEyes, [&stereo](double value) { stereo.set_screen_width_m(value); },
      "Of whom the comfort report is for [1]");
  AddNumber(
      command, "--viewing-distance", "M", kEyes, [&stereo](double value) { stereo.set_viewing_distance_m(value); },
      "Of whom the comfort report is for [3]");
  AddWord<v1::RenderOptions::FrameFormat>(
      command, "--frames", "FRAME_FORMAT_", "Options", [&flags](auto format) { flags.frame_format = format; },
      "How pictures are stored [png]");
}

absl::StatusOr<std::vector<v1::RenderOptions>> RendersOf(const RenderFlags& flags,
                                                         v1::RenderOptions::Container container) {
  if (!flags.dof && flags.dof_options.ByteSizeLong() > 0) {
    return absl::InvalidArgumentError("lens and focus are for --dof, which was not given");
  }
  if (!flags.stereo && flags.stereo_options.ByteSizeLong() > 0) {
    return absl::InvalidArgumentError("baseline, format and the like are for --stereo, which was not given");
  }
  std::vector<v1::RenderOptions> renders;
  if (flags.dof) *renders.emplace_back().mutable_depth_of_field() = flags.dof_options;
  if (flags.stereo) *renders.emplace_back().mutable_stereo() = flags.stereo_options;
  for (v1::RenderOptions& render : renders) {
    render.set_frame_format(flags.frame_format);
    render.set_container(container);
  }
  return renders;
}

}  // namespace depthtween::cli
