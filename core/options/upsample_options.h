// The options of an upsampling: what users ask for, locally or from a server. Names, defaults, rules and help stand in
// upsample_options.cc and nowhere else.
#ifndef DEPTHTWEEN_CORE_OPTIONS_UPSAMPLE_OPTIONS_H_
#define DEPTHTWEEN_CORE_OPTIONS_UPSAMPLE_OPTIONS_H_

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/options/option.h"

namespace depthtween {

// "ours" and the baselines.
const std::vector<std::string>& UpsampleMethods();
// All baselines, in the order that tables show them. MakeBaseline (core/baselines) knows each.
const std::vector<std::string>& BaselineNames();
// Of method "ours", from the fastest on. PipelineOptions::ForPreset (core/upsample) knows each.
const std::vector<std::string>& PresetNames();
// Stages of method "ours" that can be left out, and the terms and detectors of its joint optimisation.
// PipelineOptions::SwitchOff knows each.
const std::vector<std::string>& PartNames();
// Terms that preset "reference" can use in the paper's published form. SolveOptions::TakeLiterally (core/solve) knows
// each.
const std::vector<std::string>& LiteralNames();

// The most threads of one run, locally or on a server.
inline constexpr int kMaxThreads = 1024;

struct UpsampleOptions {
  std::string method = "ours";
  int key_every = 1;
  std::string clock = "stamps";       // see ClockChoice (core/sequence/clock.h)
  std::string registration = "none";  // option "register": none or estimate, see core/capture/register.h
  bool scene_flow = false;
  // Of method "ours" alone.
  std::string preset = "balanced";
  bool causal = false;
  bool self_check = false;
  std::string fill = "near";  // see Fill (core/upsample/fill_limit.h)
  std::vector<std::string> without;
  std::vector<std::string> literal;
  // Not part of the document, because they do not change depth: how a run is made, not what it computes.
  int threads = 1;           // 1 to kMaxThreads
  bool keep_motion = false;  // between colour frames, for renders that look at other frames

  bool NeedsMotion() const { return keep_motion || scene_flow; }
};

const std::vector<OptionSpec>& UpsampleOptionSpecs();

// Every option of the document.
nlohmann::json ToJson(const UpsampleOptions& options);
// What is left out has its default. `path` names the document in messages. InvalidArgument about the wrong field, which
// FieldOf (field_error.h) gives: unknown, of the wrong type, out of range, or at odds with another.
absl::StatusOr<UpsampleOptions> ParseUpsampleOptions(const nlohmann::json& document,
                                                     const std::string& path = "options");
// The rules of the document, for options that were not parsed from one.
absl::Status Validate(const UpsampleOptions& options, const std::string& path = "options");

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_OPTIONS_UPSAMPLE_OPTIONS_H_
