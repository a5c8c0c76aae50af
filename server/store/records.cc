#include "server/store/records.h"

#include <algorithm>
#include <array>

#include "absl/strings/escaping.h"
#include "core/sequence/clock.h"
#include "core/sequence/upsample_names.h"
#include "server/store/error_info.h"

namespace depthtween::server {

std::string_view ToString(SequenceState state) {
  switch (state) {
    case SequenceState::kUploading:
      return "UPLOADING";
    case SequenceState::kValidating:
      return "VALIDATING";
    case SequenceState::kReady:
      return "READY";
    case SequenceState::kInvalid:
      return "INVALID";
  }
  return "UNKNOWN";
}

std::string_view ToString(JobState state) {
  switch (state) {
    case JobState::kQueued:
      return "QUEUED";
    case JobState::kRunning:
      return "RUNNING";
    case JobState::kCancelling:
      return "CANCELLING";
    case JobState::kSucceeded:
      return "SUCCEEDED";
    case JobState::kFailed:
      return "FAILED";
    case JobState::kCancelled:
      return "CANCELLED";
  }
  return "UNKNOWN";
}

std::string_view ToString(TaskKind kind) {
  switch (kind) {
    case TaskKind::kValidate:
      return "validate";
    case TaskKind::kPrepare:
      return "prepare";
    case TaskKind::kIntervals:
      return "intervals";
    case TaskKind::kAssemble:
      return "assemble";
    case TaskKind::kRender:
      return "render";
    case TaskKind::kSelfCheck:
      return "self-check";
  }
  return "unknown";
}

int JobRecord::RenderedFramesDone() const {
  int done = 0;
  for (const RenderRecord& render : renders) done += render.frames_done;
  return done;
}

bool JobRecord::IsComputed() const {
  return intervals_total > 0 && intervals_done == intervals_total && RenderedFramesDone() == RenderedFramesTotal();
}

absl::Status UpsampleOptions::Validate() const {
  const auto bad = [](const std::string& field, const std::string& message) {
    return BadField("job.options." + field, absl::StrCat("UpsampleOptions.", field, " ", message));
  };
  const auto check = [&](const char* field, const std::string& name, const std::vector<std::string>& known) {
    if (std::find(known.begin(), known.end(), name) != known.end()) return absl::OkStatus();
    return bad(field, absl::StrCat("= \"", absl::CEscape(name), "\", must be one of: ", absl::StrJoin(known, ", ")));
  };
  RETURN_IF_ERROR(check("method", method, UpsampleMethods()));
  RETURN_IF_ERROR(check("preset", preset, PresetNames()));
  for (const std::string& part : without) RETURN_IF_ERROR(check("without", part, PartNames()));
  for (const std::string& choice : literal) RETURN_IF_ERROR(check("literal", choice, LiteralNames()));
  const auto only_ours = [&](const char* field) {
    return bad(field, absl::StrCat("is for method \"ours\" alone, and the method is \"", method, "\""));
  };
  if (method != "ours" && preset != UpsampleOptions().preset) return only_ours("preset");
  if (method != "ours" && !without.empty()) return only_ours("without");
  if (method != "ours" && !literal.empty()) return only_ours("literal");
  if (method != "ours" && causal) return only_ours("causal");
  if (method != "ours" && self_check) return only_ours("self_check");
  if (method != "ours" && scene_flow) return only_ours("scene_flow");
  if (preset != "reference" && !literal.empty()) {
    return bad("literal", absl::StrCat("is for preset \"reference\" alone, and the preset is \"", preset, "\""));
  }
  if (causal && scene_flow) {
    return bad("scene_flow", "does not go with causal: what follows a frame is not known then");
  }
  if (const absl::Status known = ParseClockChoice(clock).status(); !known.ok()) {
    return bad("clock", std::string(known.message()));
  }
  if (key_every < 1) return bad("key_every", absl::StrCat("= ", key_every, ", must be >= 1"));
  if (threads < 0 || threads > kMaxThreads) {
    return bad("threads", absl::StrCat("= ", threads, ", must be 0 (the server decides) to ", kMaxThreads));
  }
  return absl::OkStatus();
}

absl::Status SceneFlowOptions::Validate() const {
  constexpr int kMaxEvery = 1'000'000;
  constexpr double kMinBaselineM = 1e-4, kMaxBaselineM = 100.0;
  const auto bad = [](const std::string& field, const std::string& message) {
    return BadField("job.scene_flow_options." + field, absl::StrCat("SceneFlowOptions.", field, " ", message));
  };
  const auto knows = [](const std::vector<std::string>& known, const std::string& name) {
    return std::find(known.begin(), known.end(), name) != known.end();
  };
  if (!knows(SceneFlowMethods(), method)) {
    return bad("method", absl::StrCat("= \"", absl::CEscape(method),
                                      "\", must be one of: ", absl::StrJoin(SceneFlowMethods(), ", ")));
  }
  if (!knows(formats, "npz")) return bad("formats", "has no \"npz\", which every job writes");
  for (const std::string& format : formats) {
    if (!knows(SceneFlowFormats(), format)) {
      return bad("formats", absl::StrCat("has \"", absl::CEscape(format),
                                         "\", must be some of: ", absl::StrJoin(SceneFlowFormats(), ", ")));
    }
  }
  if (every < 1 || every > kMaxEvery) return bad("every", absl::StrCat("= ", every, ", must be 1 to ", kMaxEvery));
  if (!(baseline_m >= kMinBaselineM && baseline_m <= kMaxBaselineM)) {
    return bad("baseline_m", absl::StrCat("= ", baseline_m, ", must be ", kMinBaselineM, " to ", kMaxBaselineM));
  }
  return absl::OkStatus();
}

absl::Status NewJob::Validate() const {
  RETURN_IF_ERROR(options.Validate());
  if (!scene_flow_options) return absl::OkStatus();
  const auto not_both = [](const char* field) {
    return BadField(field, absl::StrCat(field, " is for jobs that upsample, and this one has scene_flow_options"));
  };
  if (!renders.empty()) return not_both("job.renders");
  if (!depth_from.empty()) return not_both("job.depth_from");
  const UpsampleOptions defaults;
  if (options.method != defaults.method) return not_both("job.options.method");
  if (options.key_every != defaults.key_every) return not_both("job.options.key_every");
  if (options.clock != defaults.clock) return not_both("job.options.clock");
  if (options.preset != defaults.preset) return not_both("job.options.preset");
  if (!options.without.empty()) return not_both("job.options.without");
  if (!options.literal.empty()) return not_both("job.options.literal");
  if (options.causal) return not_both("job.options.causal");
  if (options.self_check) return not_both("job.options.self_check");
  if (options.scene_flow) return not_both("job.options.scene_flow");
  return scene_flow_options->Validate();
}

}  // namespace depthtween::server
