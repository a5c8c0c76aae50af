#include "core/session/render_options.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/session/render_run.h"

namespace depthtween {
namespace {

using nlohmann::json;

constexpr size_t kMaxNameBytes = 40;

// What a result folder holds beside renders.
constexpr std::array kReservedNames = {"depth",  "uncertainty", "provenance", "motion", "report",
                                       "camera", "timestamps",  "rgb",        "gt"};

template <typename T>
struct Word {
  const char* name;
  T value;
};
constexpr Word<FrameFormat> kFrameFormats[] = {{"png", FrameFormat::kPng}, {"jpeg", FrameFormat::kJpeg}};
constexpr Word<VideoContainer> kContainers[] = {{"mp4", VideoContainer::kMp4}, {"mkv", VideoContainer::kMatroska}};
constexpr Word<DepthOfFieldMethod> kMethods[] = {{"layers", DepthOfFieldMethod::kLayers},
                                                 {"kraus", DepthOfFieldMethod::kKraus},
                                                 {"gather", DepthOfFieldMethod::kGather}};
constexpr Word<MadeEye> kEyes[] = {{"left", MadeEye::kLeft}, {"right", MadeEye::kRight}, {"both", MadeEye::kBoth}};
constexpr Word<FocusEasing> kEasings[] = {{"smooth", FocusEasing::kSmooth}, {"linear", FocusEasing::kLinear}};

// Reads the fields of one object. The first error stays; Finish() gives it, or the field that nobody asked for.
class ObjectReader {
 public:
  ObjectReader(const json& object, std::string path) : object_(object), path_(std::move(path)) {
    if (!object.is_object()) Fail(absl::InvalidArgumentError(absl::StrCat(path_, " must be a JSON object")));
  }

  bool Has(const std::string& name) {
    known_.insert(name);
    return error_.ok() && object_.contains(name);
  }
  std::string PathOf(const std::string& name) const { return absl::StrCat(path_, ".", name); }
  const json& At(const std::string& name) const { return object_.at(name); }

  void Number(const std::string& name, double& out) {
    if (!Has(name)) return;
    const json& value = At(name);
    if (!value.is_number()) return Wrong(name, "a number");
    out = value.get<double>();
  }
  void Number(const std::string& name, std::optional<double>& out) {
    if (!Has(name)) return;
    double value = 0;
    Number(name, value);
    out = value;
  }
  void Integer(const std::string& name, int& out) {
    if (!Has(name)) return;
    const json& value = At(name);
    if (!value.is_number_integer() || value.get<json::number_integer_t>() != value.get<int>())
      return Wrong(name, "a whole number");
    out = value.get<int>();
  }
  void Flag(const std::string& name, bool& out) {
    if (!Has(name)) return;
    if (!At(name).is_boolean()) return Wrong(name, "true or false");
    out = At(name).get<bool>();
  }
  void Text(const std::string& name, std::string& out) {
    if (!Has(name)) return;
    if (!At(name).is_string()) return Wrong(name, "a string");
    out = At(name).get<std::string>();
  }
  template <typename T, size_t N>
  bool OneOf(const std::string& name, const Word<T> (&words)[N], T& out) {
    if (!Has(name)) return false;
    for (const Word<T>& word : words) {
      if (At(name) == word.name) {
        out = word.value;
        return true;
      }
    }
    Wrong(name, absl::StrCat("one of: ", absl::StrJoin(words, ", ", [](std::string* text, const Word<T>& word) {
                               absl::StrAppend(text, word.name);
                             })));
    return false;
  }

  void Wrong(const std::string& name, const std::string& rule) {
    Fail(FieldError(PathOf(name), absl::StrCat("= ", At(name).dump(-1, ' ', false, json::error_handler_t::replace),
                                               ", must be ", rule)));
  }
  void Fail(const absl::Status& status) { error_.Update(status); }

  absl::Status Finish() {
    RETURN_IF_ERROR(error_);
    for (const auto& [name, value] : object_.items()) {
      if (known_.count(name) == 0)
        return FieldError(PathOf(name), absl::StrCat("is not known: known are ", absl::StrJoin(known_, ", ")));
    }
    return absl::OkStatus();
  }

 private:
  const json& object_;
  const std::string path_;
  std::set<std::string> known_;
  absl::Status error_;
};

absl::StatusOr<FocusPixel> ParsePixel(const json& value, const std::string& path) {
  ObjectReader reader(value, path);
  FocusPixel pixel;
  reader.Integer("frame", pixel.frame);
  reader.Number("x", pixel.x);
  reader.Number("y", pixel.y);
  RETURN_IF_ERROR(reader.Finish());
  return pixel;
}

absl::StatusOr<FocusKeys> ParseKeys(const json& value, const std::string& path) {
  ObjectReader reader(value, path);
  FocusKeys keys;
  reader.OneOf("easing", kEasings, keys.easing);
  if (reader.Has("keys")) {
    const json& list = reader.At("keys");
    if (!list.is_array()) reader.Wrong("keys", "a list");
    for (size_t i = 0; list.is_array() && i < list.size(); ++i) {
      ObjectReader key(list[i], absl::StrCat(path, ".keys[", i, "]"));
      FocusKey& added = keys.keys.emplace_back();
      key.Integer("frame", added.frame);
      key.Number("depth_m", added.depth_m);
      reader.Fail(key.Finish());
    }
  }
  RETURN_IF_ERROR(reader.Finish());
  return keys;
}

absl::StatusOr<FocusOptions> ParseFocus(const json& value, const std::string& path) {
  ObjectReader reader(value, path);
  FocusOptions focus;
  int modes = 0;
  if (reader.Has("depth_m")) {
    double depth_m = 0;
    reader.Number("depth_m", depth_m);
    focus = FocusDepth{depth_m};
    ++modes;
  }
  if (reader.Has("pixel")) {
    ASSIGN_OR_RETURN(focus, ParsePixel(reader.At("pixel"), reader.PathOf("pixel")));
    ++modes;
  }
  if (reader.Has("track")) {
    ASSIGN_OR_RETURN(const FocusPixel start, ParsePixel(reader.At("track"), reader.PathOf("track")));
    focus = FocusTrack{start};
    ++modes;
  }
  if (reader.Has("keys")) {
    ASSIGN_OR_RETURN(focus, ParseKeys(reader.At("keys"), reader.PathOf("keys")));
    ++modes;
  }
  RETURN_IF_ERROR(reader.Finish());
  if (modes > 1) return FieldError(path, "has several of depth_m, pixel, track and keys, must have one");
  return focus;
}

absl::StatusOr<DepthOfFieldRender> ParseDepthOfField(const json& value, const std::string& path) {
  ObjectReader reader(value, path);
  DepthOfFieldRender render;
  reader.Number("focal_mm", render.lens.focal_mm);
  reader.Number("fstop", render.lens.fstop);
  reader.Number("aperture_mm", render.lens.aperture_mm);
  reader.Text("sensor", render.lens.sensor);
  reader.OneOf("method", kMethods, render.blur.method);
  reader.Integer("layers", render.blur.layers);
  reader.Integer("blades", render.blur.blades);
  reader.Number("max_radius_px", render.blur.max_radius_px);
  if (reader.Has("focus")) {
    ASSIGN_OR_RETURN(render.focus, ParseFocus(reader.At("focus"), reader.PathOf("focus")));
  }
  RETURN_IF_ERROR(reader.Finish());
  RETURN_IF_ERROR(InObject(path, render.lens.Validate()));
  RETURN_IF_ERROR(InObject(path, render.blur.Validate()));
  return render;
}

absl::StatusOr<StereoRender> ParseStereo(const json& value, const std::string& path) {
  ObjectReader reader(value, path);
  StereoRender render;
  reader.OneOf("made", kEyes, render.eyes.made);
  reader.Number("baseline_m", render.eyes.baseline_m);
  reader.Number("divergence_percent", render.eyes.divergence_percent);
  reader.Number("convergence_m", render.eyes.convergence_m);
  reader.Flag("floating_window", render.eyes.floating_window);
  reader.Flag("metadata", render.metadata);
  reader.Number("screen_width_m", render.screen.width_m);
  reader.Number("viewing_distance_m", render.screen.distance_m);
  std::string format;
  reader.Text("format", format);
  RETURN_IF_ERROR(reader.Finish());
  if (!format.empty()) {
    const absl::StatusOr<StereoFormat> parsed = ParseStereoFormat(format);
    if (!parsed.ok()) return InObject(path, parsed.status());
    render.format = *parsed;
  }
  RETURN_IF_ERROR(InObject(path, render.eyes.Validate()));
  RETURN_IF_ERROR(InObject(path, render.screen.Validate()));
  return render;
}

absl::Status CheckName(const std::string& name, const std::string& path) {
  const bool plain = name.size() <= kMaxNameBytes && absl::ascii_islower(name[0]) &&
                     std::all_of(name.begin(), name.end(), [](unsigned char c) {
                       return absl::ascii_islower(c) || absl::ascii_isdigit(c) || c == '-';
                     });
  if (!plain)
    return FieldError(path, absl::StrFormat("= '%s', must be lower-case letters, digits and '-', beginning with a "
                                            "letter, at most %d",
                                            name, kMaxNameBytes));
  if (std::find(kReservedNames.begin(), kReservedNames.end(), name) != kReservedNames.end())
    return FieldError(path, absl::StrFormat("= '%s', which names another output: choose another", name));
  return absl::OkStatus();
}

std::vector<std::string> StreamsOf(const RenderOptions& options) {
  const auto* stereo = std::get_if<StereoRender>(&options.product);
  if (stereo == nullptr || stereo->format != StereoFormat::kSeparate) return {options.name};
  return {options.name + "-left", options.name + "-right"};
}

// Of a picture as it is written.
std::pair<int, int> PictureSize(const RenderOptions& options, const Camera& camera) {
  int width = camera.width, height = camera.height;
  if (const auto* stereo = std::get_if<StereoRender>(&options.product)) {
    switch (stereo->format) {
      case StereoFormat::kFullSbs:
        width *= 2;
        break;
      case StereoFormat::kHalfSbs:
        width = (width + 1) / 2 * 2;
        break;
      case StereoFormat::kFullTb:
        height *= 2;
        break;
      case StereoFormat::kHalfTb:
        height = (height + 1) / 2 * 2;
        break;
      default:
        break;
    }
  }
  return {width, height};
}

absl::Status CheckFrame(int frame, const Sequence& sequence, const std::string& path) {
  const int count = static_cast<int>(sequence.color.size());
  if (frame >= 0 && frame < count) return absl::OkStatus();
  return FieldError(path,
                    absl::StrFormat("= %d, must be 0 to %d: the recording has %d frames", frame, count - 1, count));
}

absl::Status CheckPixel(const FocusPixel& pixel, const Sequence& sequence, const std::string& path) {
  RETURN_IF_ERROR(CheckFrame(pixel.frame, sequence, path + ".frame"));
  const auto inside = [](double position, int size) { return position >= -0.5 && position < size - 0.5; };
  if (!inside(pixel.x, sequence.camera.width))
    return FieldError(path + ".x", absl::StrFormat("= %g, must be a pixel of the image, which is %d wide", pixel.x,
                                                   sequence.camera.width));
  if (!inside(pixel.y, sequence.camera.height))
    return FieldError(path + ".y", absl::StrFormat("= %g, must be a pixel of the image, which is %d high", pixel.y,
                                                   sequence.camera.height));
  return absl::OkStatus();
}

// A depth that was given against the lens that is to focus on it.
absl::Status CheckFocusDepth(double depth_m, const DepthOfFieldRender& render, const Camera& camera,
                             const std::string& path) {
  const absl::Status made = MakeCircleOfConfusion(camera, render.lens, depth_m).status();
  if (made.ok()) return made;
  const absl::string_view message = made.message();
  return FieldError(path, std::string(message.substr(std::min(message.find(' ') + 1, message.size()))));
}

absl::Status CheckFocus(const DepthOfFieldRender& render, const Sequence& sequence, const std::string& path) {
  if (const auto* depth = std::get_if<FocusDepth>(&render.focus))
    return CheckFocusDepth(depth->depth_m, render, sequence.camera, path + ".depth_m");
  if (const auto* pixel = std::get_if<FocusPixel>(&render.focus)) return CheckPixel(*pixel, sequence, path + ".pixel");
  if (const auto* track = std::get_if<FocusTrack>(&render.focus))
    return CheckPixel(track->start, sequence, path + ".track");
  if (const auto* keys = std::get_if<FocusKeys>(&render.focus)) {
    if (keys->keys.empty()) return FieldError(path + ".keys.keys", "is empty, must have at least one key");
    for (size_t i = 0; i < keys->keys.size(); ++i) {
      const std::string key = absl::StrCat(path, ".keys.keys[", i, "]");
      RETURN_IF_ERROR(CheckFrame(keys->keys[i].frame, sequence, key + ".frame"));
      if (i > 0 && keys->keys[i].frame <= keys->keys[i - 1].frame)
        return FieldError(key + ".frame", absl::StrFormat("= %d, must be after the key before, frame %d",
                                                          keys->keys[i].frame, keys->keys[i - 1].frame));
      RETURN_IF_ERROR(CheckFocusDepth(keys->keys[i].depth_m, render, sequence.camera, key + ".depth_m"));
    }
  }
  return absl::OkStatus();
}

const char* NameOf(VideoContainer container) { return container == VideoContainer::kMp4 ? "mp4" : "mkv"; }

}  // namespace

absl::StatusOr<RenderOptions> ParseRender(const json& value, const std::string& path) {
  ObjectReader reader(value, path);
  RenderOptions options;
  const bool blurs = reader.Has("depth_of_field"), doubles = reader.Has("stereo");
  reader.Text("name", options.name);
  reader.OneOf("frame_format", kFrameFormats, options.frame_format);
  VideoContainer container;
  if (reader.OneOf("container", kContainers, container)) options.container = container;
  RETURN_IF_ERROR(reader.Finish());
  if (blurs == doubles) return FieldError(path, "must have one product: depth_of_field or stereo");
  if (blurs) {
    ASSIGN_OR_RETURN(options.product, ParseDepthOfField(reader.At("depth_of_field"), reader.PathOf("depth_of_field")));
  } else {
    ASSIGN_OR_RETURN(options.product, ParseStereo(reader.At("stereo"), reader.PathOf("stereo")));
  }
  if (options.name.empty()) options.name = blurs ? "dof" : "stereo";
  RETURN_IF_ERROR(CheckName(options.name, reader.PathOf("name")));
  return options;
}

absl::StatusOr<std::vector<RenderOptions>> ParseRenders(const json& list) {
  if (!list.is_array()) return FieldError("renders", "must be a list");
  std::vector<RenderOptions> renders;
  std::set<std::string> taken;
  for (size_t i = 0; i < list.size(); ++i) {
    const std::string path = absl::StrCat("renders[", i, "]");
    ASSIGN_OR_RETURN(RenderOptions options, ParseRender(list[i], path));
    if (list[i].value("name", "").empty()) {
      const std::string kind = options.name;
      for (int number = 2; taken.count(options.name) > 0; ++number) options.name = absl::StrCat(kind, "-", number);
    }
    std::vector<std::string> names = StreamsOf(options);
    if (names.size() > 1) names.push_back(options.name);  // "stereo" and "stereo-left" must not be of two renders
    for (const std::string& name : names) {
      if (!taken.insert(name).second)
        return FieldError(path + ".name", absl::StrFormat("= '%s', which another render has too", name));
    }
    renders.push_back(std::move(options));
  }
  return renders;
}

VideoOptions VideoOptionsOf(const RenderOptions& options, VideoContainer container) {
  VideoOptions video = {.container = container};
  if (const auto* stereo = std::get_if<StereoRender>(&options.product)) {
    const StereoFormatFacts& facts = FactsOf(stereo->format);
    video.full_chroma = facts.full_chroma;
    if (stereo->metadata && facts.packing != StereoPacking::kNone)
      video.stereo = facts.packing == StereoPacking::kSideBySide ? VideoStereo::kSideBySide : VideoStereo::kTopBottom;
  }
  return video;
}

std::string VideoFileName(const RenderOptions& options, const std::string& stem, size_t index,
                          VideoContainer container) {
  std::string_view suffix;
  if (const auto* stereo = std::get_if<StereoRender>(&options.product))
    suffix = FactsOf(stereo->format).suffixes[index];
  return absl::StrCat(stem, std::string(suffix), ".", NameOf(container));
}

absl::StatusOr<RenderPlan> PlanRender(const RenderOptions& options, const Sequence& sequence, const std::string& path) {
  RenderPlan plan = {.reach_frames = kRenderReachFrames,
                     .uses_motion = true,
                     .streams = StreamsOf(options),
                     .extension = options.frame_format == FrameFormat::kPng ? "png" : "jpg"};
  if (const auto* blur = std::get_if<DepthOfFieldRender>(&options.product)) {
    RETURN_IF_ERROR(CheckFocus(*blur, sequence, path + ".depth_of_field.focus"));
    const auto* pixel = std::get_if<FocusPixel>(&blur->focus);
    const auto* track = std::get_if<FocusTrack>(&blur->focus);
    if (pixel != nullptr) plan.anchor_frame = pixel->frame;
    if (track != nullptr) plan.anchor_frame = track->start.frame;
    // The baselines know no other frames.
    if (blur->blur.method != DepthOfFieldMethod::kLayers) plan.reach_frames = 0;
    plan.uses_motion = plan.reach_frames > 0 || track != nullptr;
  }
  if (options.container) {
    VideoOptions video = VideoOptionsOf(options, *options.container);
    std::tie(video.width, video.height) = PictureSize(options, sequence.camera);
    if (const absl::Status valid = video.Validate(); !valid.ok())
      return FieldError(path + ".container", absl::StrCat("= ", NameOf(*options.container), ": ", valid.message()));
    for (size_t i = 0; i < plan.streams.size(); ++i)
      plan.videos.push_back(VideoFileName(options, options.name, i, *options.container));
  }
  return plan;
}

json ToJson(const RenderOptions& options, const RenderPlan& plan) {
  return {{"name", options.name},
          {"reach_frames", plan.reach_frames},
          {"anchor_frame", plan.anchor_frame},
          {"uses_motion", plan.uses_motion},
          {"streams", plan.streams},
          {"extension", plan.extension},
          {"videos", plan.videos}};
}

}  // namespace depthtween
