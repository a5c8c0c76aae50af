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
  const auto only_ours = [&](const char* field) {
    return bad(field, absl::StrCat("is for method \"ours\" alone, and the method is \"", method, "\""));
  };
  if (method != "ours" && preset != UpsampleOptions().preset) return only_ours("preset");
  if (method != "ours" && !without.empty()) return only_ours("without");
  if (method != "ours" && causal) return only_ours("causal");
  if (method != "ours" && self_check) return only_ours("self_check");
  if (method != "ours" && scene_flow) return only_ours("scene_flow");
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

}  // namespace depthtween::server
