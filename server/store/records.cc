#include "server/store/records.h"

#include "core/options/field_error.h"
#include "core/options/upsample_options.h"
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

absl::StatusOr<NewJob> NewJob::Checked() const {
  const bool upsamples = kind == JobKind::kUpsample;
  if (priority < -kMaxPriority || priority > kMaxPriority) {
    return BadField("job.priority", absl::StrCat("job.priority = ", priority, ", must be ", -kMaxPriority, " to ",
                                                 kMaxPriority, " (0 is usual, higher goes first)"));
  }
  if (threads < 0 || threads > kMaxThreads) {
    return BadField("job.threads",
                    absl::StrCat("job.threads = ", threads, ", must be 0 (the server decides) to ", kMaxThreads));
  }
  for (const auto& [field, limit] :
       {std::pair("job.queue_time_limit", this->limits.queue), {"job.run_time_limit", this->limits.run}}) {
    if (limit != absl::ZeroDuration() && (limit < kLeastTimeLimit || limit > kMostTimeLimit)) {
      return BadField(field, absl::StrCat(field, " = ", absl::FormatDuration(limit), ", must be ",
                                          absl::FormatDuration(kLeastTimeLimit), " to ",
                                          absl::FormatDuration(kMostTimeLimit), ", or 0 for no limit of its own"));
    }
  }
  for (const auto& [field, is_set] :
       {std::pair("job.renders", !renders.empty()), {"job.depth_from", !depth_from.empty()}}) {
    if (is_set && !upsamples) {
      return BadField(field, absl::StrCat(field, " is for jobs that upsample, and this one has scene_flow_options"));
    }
  }
  const absl::StatusOr<std::string> canonical =
      CanonicalJobOptions(kind, options, upsamples ? "job.options" : "job.scene_flow_options");
  if (!canonical.ok()) return BadField(FieldOf(canonical.status()), std::string(canonical.status().message()));
  NewJob checked = *this;
  checked.options = *canonical;
  return checked;
}

}  // namespace depthtween::server
