#include "core/options/upsample_options.h"

#include <limits>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/options/field_error.h"
#include "core/options/option_members.h"
#include "core/sequence/clock.h"

namespace depthtween {
namespace {

using nlohmann::json;

constexpr char kQuality[] = "Accuracy and time (method ours)";
constexpr char kResearch[] = "For research";

// More depth frames than this are in no recording that a server takes, and 2 x N must be a number too: a self-check
// holds out every second key.
constexpr int kMaxKeyEvery = 100'000;

absl::Status CheckClock(std::string_view text) { return ParseClockChoice(text).status(); }

const OptionMembers<UpsampleOptions>& UpsampleMembers() {
  using O = UpsampleOptions;
  static const auto* const list = [] {
    auto* const members = new OptionMembers<O>;
    members
        ->Add<&O::preset>({.name = "preset",
                           .help = "What accuracy may cost: see below",
                           .placeholder = absl::StrJoin(PresetNames(), "|"),
                           .group = kQuality,
                           .words = PresetNames()})
        .Add<&O::causal>({.name = "causal",
                          .help = "Use no later frame, for low latency: each frame from the last depth frames and the "
                                  "colour frames up to it",
                          .group = kQuality})
        .Add<&O::self_check>({.name = "self_check",
                              .help =
                                  "First hold out every second depth frame and report the error of ours, flow-warp, "
                                  "linear and hold on it; costs at most what 24 intervals cost",
                              .group = kQuality})
        .Add<&O::fill>({.name = "fill",
                        .help =
                            "How far depth may be inferred where the depth camera saw nothing: all (everywhere), near "
                            "(small holes: a twentieth of the width from what was seen) or none; beyond it depth is "
                            "unknown",
                        .placeholder = "all|near|none",
                        .group = kQuality,
                        .words = {"all", "near", "none"}})
        .Add<&O::clock>({.name = "clock",
                         .help =
                             "How depth frames come onto the colour camera's clock: stamps (they are right), index "
                             "(pair by index and the ratio of the rates), estimate (measure it from the images), or "
                             "how far the depth clock is ahead at the first colour frame, in ms, and how much it "
                             "gains, in ppm",
                         .placeholder = "stamps|index|estimate|MS[,PPM]",
                         .check = CheckClock})
        .Add<&O::registration>({.name = "register",
                                .help =
                                    "What to do about depth that lies beside colour in the image, which is measured "
                                    "and said in any case: none (take it as it lies) or estimate (move it, where the "
                                    "images tell shift, scale and parallax)",
                                .placeholder = "none|estimate",
                                .words = {"none", "estimate"}})
        .Add<&O::scene_flow>({.name = "scene_flow",
                              .help =
                                  "Also compute the 3-D motion of every frame to the next, from its depth and motion: "
                                  "sceneflow/*.npz (see `sceneflow --help`), except before the first and after the "
                                  "last depth frame"})
        .Add<&O::method>({.name = "method",
                          .help = "How: " + absl::StrJoin(UpsampleMethods(), ", ") + "; all but ours are baselines",
                          .placeholder = "NAME",
                          .group = kResearch,
                          .words = UpsampleMethods()})
        .Add<&O::key_every>({.name = "key_every",
                             .help = "Use only depth frames 0, N, 2N...; the others can serve as truth",
                             .placeholder = "N",
                             .group = kResearch,
                             .min = 1,
                             .max = kMaxKeyEvery})
        .Add<&O::without>(
            {.name = "without",
             .help = "Leave stages out, to learn what each is worth: names with commas between them, of " +
                     absl::StrJoin(PartNames(), ", "),
             .placeholder = "NAMES",
             .group = kResearch,
             .words = PartNames()})
        .Add<&O::literal>({.name = "literal",
                           .help = "With preset reference, use the paper's published form of these terms: names with "
                                   "commas between them, of " +
                                   absl::StrJoin(LiteralNames(), ", "),
                           .placeholder = "NAMES",
                           .group = kResearch,
                           .words = LiteralNames()});
    return members;
  }();
  return *list;
}

// The rules between options.
absl::Status CheckTogether(const UpsampleOptions& options, const std::string& path) {
  const UpsampleOptions defaults;
  const auto error = [&](const char* field, const std::string& what) {
    return FieldError(absl::StrCat(path, ".", field), what);
  };
  if (options.method != defaults.method) {
    const std::pair<const char*, bool> of_ours[] = {{"preset", options.preset != defaults.preset},
                                                    {"without", !options.without.empty()},
                                                    {"literal", !options.literal.empty()},
                                                    {"causal", options.causal},
                                                    {"self_check", options.self_check},
                                                    {"fill", options.fill != defaults.fill},
                                                    {"scene_flow", options.scene_flow}};
    for (const auto& [field, is_set] : of_ours)
      if (is_set)
        return error(field, absl::StrFormat("is for method 'ours' alone, and the method is '%s'", options.method));
  }
  if (options.preset != "reference" && !options.literal.empty())
    return error("literal", absl::StrFormat("is for preset 'reference' alone, and the preset is '%s'", options.preset));
  if (options.causal && options.scene_flow)
    return error("scene_flow", "does not go with causal: what follows a frame is not known then");
  return absl::OkStatus();
}

}  // namespace

const std::vector<std::string>& UpsampleMethods() {
  static const auto* const list = [] {
    auto* const names = new std::vector<std::string>(BaselineNames());
    names->insert(names->begin(), "ours");
    return names;
  }();
  return *list;
}

const std::vector<std::string>& BaselineNames() {
  static const auto* const list =
      new std::vector<std::string>{"hold", "nearest", "linear", "dolson", "dolson-mode", "tracking", "flow-warp"};
  return *list;
}

const std::vector<std::string>& PresetNames() {
  static const auto* const list = new std::vector<std::string>{"fast", "balanced", "best", "reference"};
  return *list;
}

const std::vector<std::string>& PartNames() {
  static const auto* const list = new std::vector<std::string>{
      "settle", "recover", "thin",  "draw", "solve", "propagation", "median", "witnesses", "silhouettes",
      "opti",   "point",   "plane", "proj", "rigid", "reg",         "short",  "occlusion", "topology"};
  return *list;
}

const std::vector<std::string>& LiteralNames() {
  static const auto* const list = new std::vector<std::string>{"closest", "coherence", "kernels", "occlusion", "point",
                                                               "proj",    "rigid",     "short",   "topology"};
  return *list;
}

const std::vector<OptionSpec>& UpsampleOptionSpecs() { return UpsampleMembers().specs(); }

json ToJson(const UpsampleOptions& options) { return UpsampleMembers().ToJson(options); }

absl::StatusOr<UpsampleOptions> ParseUpsampleOptions(const json& document, const std::string& path) {
  ASSIGN_OR_RETURN(const json filled, FillDocument(UpsampleOptionSpecs(), document, path));
  UpsampleOptions options = UpsampleMembers().FromFilled(filled);
  RETURN_IF_ERROR(CheckTogether(options, path));
  return options;
}

absl::Status Validate(const UpsampleOptions& options, const std::string& path) {
  if (options.threads < 1 || options.threads > kMaxThreads)
    return FieldError(absl::StrCat(path, ".threads"),
                      absl::StrFormat("= %d, must be 1 to %d", options.threads, kMaxThreads));
  return ParseUpsampleOptions(ToJson(options), path).status();
}

}  // namespace depthtween
