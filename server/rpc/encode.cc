#include "server/rpc/encode.h"

#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/depthtween/documents.h"
#include "server/rpc/status.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr int kMaxRenders = 16;

v1::Sequence::State Encode(SequenceState state) {
  switch (state) {
    case SequenceState::kUploading:
      return v1::Sequence::STATE_UPLOADING;
    case SequenceState::kValidating:
      return v1::Sequence::STATE_VALIDATING;
    case SequenceState::kReady:
      return v1::Sequence::STATE_READY;
    case SequenceState::kInvalid:
      return v1::Sequence::STATE_INVALID;
  }
  return v1::Sequence::STATE_UNSPECIFIED;
}

v1::Job::State Encode(JobState state) {
  switch (state) {
    case JobState::kQueued:
      return v1::Job::STATE_QUEUED;
    case JobState::kRunning:
      return v1::Job::STATE_RUNNING;
    case JobState::kCancelling:
      return v1::Job::STATE_CANCELLING;
    case JobState::kSucceeded:
      return v1::Job::STATE_SUCCEEDED;
    case JobState::kFailed:
      return v1::Job::STATE_FAILED;
    case JobState::kCancelled:
      return v1::Job::STATE_CANCELLED;
  }
  return v1::Job::STATE_UNSPECIFIED;
}

google::protobuf::Duration Encode(absl::Duration duration) {
  google::protobuf::Duration message;
  const int64_t nanoseconds = absl::ToInt64Nanoseconds(duration);
  message.set_seconds(nanoseconds / 1'000'000'000);
  message.set_nanos(static_cast<int32_t>(nanoseconds % 1'000'000'000));
  return message;
}

// Saturates, so that no number of a stranger overflows.
absl::Duration Decode(const google::protobuf::Duration& message) {
  return absl::Seconds(message.seconds()) + absl::Nanoseconds(message.nanos());
}

v1::ClockEstimate Encode(const ClockEstimate& estimate) {
  v1::ClockEstimate message;
  message.set_summary(Summary(estimate));
  message.set_reason(estimate.reason);
  message.set_reference_ns(estimate.model.reference_ns);
  message.set_offset_ns(estimate.model.offset_ns);
  if (estimate.offset_sigma_ns >= 0) message.set_offset_sigma_ns(estimate.offset_sigma_ns);
  message.set_drift_ppm(estimate.model.drift_ppm);
  if (estimate.drift_sigma_ppm >= 0) message.set_drift_sigma_ppm(estimate.drift_sigma_ppm);
  if (estimate.stamp_sigma_ns >= 0) message.set_stamp_sigma_ns(estimate.stamp_sigma_ns);
  message.set_row_time_ns(estimate.row_time_ns);
  if (estimate.row_time_sigma_ns >= 0) message.set_row_time_sigma_ns(estimate.row_time_sigma_ns);
  message.set_keys(estimate.keys);
  message.set_edges(estimate.edges);
  return message;
}

v1::SelfCheck Encode(const SelfCheck& check) {
  v1::SelfCheck message;
  message.set_summary(check.summary);
  message.set_reason(check.reason);
  message.set_maps_checked(check.maps_checked);
  message.set_maps_held_out(check.maps_held_out);
  message.set_pixels(check.pixels);
  for (const SelfCheck::Method& method : check.methods) {
    v1::SelfCheck::Method* added = message.add_methods();
    added->set_name(method.name);
    added->set_rmse_mm(method.rmse_mm);
    added->set_mae_mm(method.mae_mm);
    if (method.edge_band_rmse_mm) added->set_edge_band_rmse_mm(*method.edge_band_rmse_mm);
    added->set_completeness(method.completeness);
    if (method.within_one_sigma) added->set_within_one_sigma(*method.within_one_sigma);
  }
  for (const SelfCheck::Frame& frame : check.worst_frames) {
    v1::SelfCheck::Frame* added = message.add_worst_frames();
    added->set_frame(frame.frame);
    added->set_stem(frame.stem);
    added->set_time_ns(frame.time_ns);
    added->set_rmse_mm(frame.rmse_mm);
  }
  if (check.sensor_floor) {
    message.set_sensor_floor_rmse_mm(check.sensor_floor->rmse_mm);
    message.set_sensor_floor_mae_mm(check.sensor_floor->mae_mm);
  }
  message.set_seconds(check.seconds);
  return message;
}

v1::Webhook::State Encode(WebhookState state) {
  switch (state) {
    case WebhookState::kWaiting:
      return v1::Webhook::STATE_WAITING;
    case WebhookState::kSending:
      return v1::Webhook::STATE_SENDING;
    case WebhookState::kDelivered:
      return v1::Webhook::STATE_DELIVERED;
    case WebhookState::kGivenUp:
      return v1::Webhook::STATE_GIVEN_UP;
  }
  return v1::Webhook::STATE_UNSPECIFIED;
}

v1::Webhook Encode(const WebhookRecord& webhook) {
  v1::Webhook message;
  message.set_url(webhook.url);
  message.set_state(Encode(webhook.state));
  message.set_attempts(webhook.attempts);
  message.set_last_error(webhook.last_error);
  if (webhook.next_time != absl::InfiniteFuture()) {
    *message.mutable_next_attempt_time() = server::Encode(webhook.next_time);
  }
  return message;
}

v1::Recording Encode(const Recording& recording) {
  v1::Recording message;
  *message.mutable_camera() = server::Encode(recording.camera);
  message.set_depth_scale(recording.depth_scale);
  message.set_color_frame_count(recording.color_frame_count);
  message.set_depth_frame_count(recording.depth_frame_count);
  message.set_first_time_ns(recording.first_time_ns);
  message.set_last_time_ns(recording.last_time_ns);
  message.set_median_depth_m(recording.median_depth_m);
  return message;
}

}  // namespace

absl::StatusOr<std::string> OptionsDocument(const std::string& field, const google::protobuf::Message& options) {
  constexpr size_t kMaxBytes = 64 << 10;  // kept with the job and read with it
  std::string document = DocumentOf(options);
  if (document.size() <= kMaxBytes) return document;
  return InvalidField(field, absl::StrCat("takes ", document.size(), " bytes as JSON, must take at most ", kMaxBytes));
}

absl::StatusOr<OutputSpec> FindOutput(const JobRecord& job, std::string_view output_id) {
  std::string known;
  for (const OutputSpec& output : OutputsOf(job)) {
    if (output.id == output_id) return output;
    absl::StrAppend(&known, known.empty() ? "" : ", ", output.id);
  }
  return WithErrorInfo(
      absl::NotFoundError(absl::StrCat("there is no output \"", View(output_id), "\"; this job has: ", known)),
      {.reason = "NO_SUCH_RESOURCE", .metadata = {{"resource", OutputName(job.id, output_id)}}});
}

absl::StatusOr<NewJob> Decode(const v1::Job& job) {
  NewJob result = {.display_name = job.display_name()};
  ASSIGN_OR_RETURN(result.sequence_id, ParseSequenceName("job.sequence", job.sequence()));
  result.threads = job.threads();
  result.priority = job.priority();
  result.limits = {.queue = Decode(job.queue_time_limit()), .run = Decode(job.run_time_limit())};
  result.pinned = job.pinned();
  if (job.renders_size() > kMaxRenders) {
    return InvalidField("job.renders",
                        absl::StrCat("has ", job.renders_size(), " elements, must have at most ", kMaxRenders));
  }
  for (int i = 0; i < job.renders_size(); ++i) {
    ASSIGN_OR_RETURN(result.renders.emplace_back().options,
                     OptionsDocument(absl::StrCat("job.renders[", i, "]"), job.renders(i)));
  }
  if (job.has_scene_flow_options()) {
    if (job.has_options() && job.options().ByteSizeLong() > 0) {
      return InvalidField("job.options", "is for jobs that upsample, and this one has scene_flow_options");
    }
    result.kind = JobKind::kSceneFlow;
    ASSIGN_OR_RETURN(result.options, OptionsDocument("job.scene_flow_options", job.scene_flow_options()));
  } else {
    ASSIGN_OR_RETURN(result.options, OptionsDocument("job.options", job.options()));
  }
  if (job.has_webhook()) {
    if (job.webhook().url().empty()) return InvalidField("job.webhook.url", "must be set");
    result.webhook_url = job.webhook().url();
  }
  if (!job.depth_from().empty()) {
    ASSIGN_OR_RETURN(result.depth_from, ParseJobName("job.depth_from", job.depth_from()));
  }
  return result;
}

google::protobuf::Timestamp Encode(absl::Time time) {
  google::protobuf::Timestamp message;
  const int64_t seconds = absl::ToUnixSeconds(time);
  message.set_seconds(seconds);
  message.set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(time - absl::FromUnixSeconds(seconds))));
  return message;
}

v1::Camera Encode(const Camera& camera) {
  v1::Camera message;
  message.set_width(camera.width);
  message.set_height(camera.height);
  message.set_fx(camera.fx);
  message.set_fy(camera.fy);
  message.set_cx(camera.cx);
  message.set_cy(camera.cy);
  message.set_k1(camera.k1);
  message.set_k2(camera.k2);
  message.set_p1(camera.p1);
  message.set_p2(camera.p2);
  message.set_k3(camera.k3);
  return message;
}

v1::Sequence Encode(const SequenceRecord& record, const ValidationProgress& progress) {
  v1::Sequence message;
  message.set_name(SequenceName(record.id));
  message.set_display_name(record.display_name);
  message.set_state(Encode(record.state));
  *message.mutable_create_time() = Encode(record.create_time);
  *message.mutable_update_time() = Encode(record.update_time);
  message.set_size_bytes(record.size_bytes);
  message.set_file_count(record.file_count);
  message.set_pinned(record.pinned);
  if (record.state == SequenceState::kValidating) {
    message.set_checked_frames(progress.checked);
    message.set_frames_to_check(progress.of);
  }
  for (const FileViolation& violation : record.validation.violations) {
    v1::FileViolation* added = message.add_violations();
    added->set_file(violation.file);
    *added->mutable_status() = ToRpcStatus(violation.status, {.subject = violation.file, .request_id = {}});
  }
  for (const std::string& warning : record.validation.warnings) message.add_warnings(warning);
  if (!record.validation.error.ok()) {
    *message.mutable_error() = ToRpcStatus(record.validation.error, {.subject = message.name(), .request_id = {}});
  }
  if (record.validation.recording) *message.mutable_recording() = Encode(*record.validation.recording);
  return message;
}

v1::Upload Encode(const UploadRecord& record) {
  v1::Upload message;
  message.set_name(UploadName(record.sequence_id, record.id));
  message.set_size_bytes(record.size_bytes);
  message.set_committed_size(record.committed_size);
  message.set_state(record.finished ? v1::Upload::STATE_FINISHED : v1::Upload::STATE_RECEIVING);
  *message.mutable_create_time() = Encode(record.create_time);
  if (record.expire_time != absl::InfiniteFuture()) *message.mutable_expire_time() = Encode(record.expire_time);
  message.set_metadata(record.metadata);
  return message;
}

v1::Progress Encode(const Progress& progress) {
  v1::Progress message;
  message.set_stage(progress.stage);
  message.set_intervals_done(progress.intervals_done);
  message.set_intervals_total(progress.intervals_total);
  message.set_frames_done(progress.frames_done);
  message.set_frames_total(progress.frames_total);
  message.set_rendered_frames_done(progress.rendered_frames_done);
  message.set_rendered_frames_total(progress.rendered_frames_total);
  message.set_fraction(progress.fraction);
  if (progress.eta) {
    v1::Progress::Eta* eta = message.mutable_eta();
    *eta->mutable_remaining() = Encode(progress.eta->remaining);
    eta->set_seconds_per_interval(progress.eta->seconds_per_interval);
    eta->set_measured_intervals(progress.eta->measured_intervals);
    eta->set_workers(progress.eta->workers);
    eta->set_seconds_per_rendered_frame(progress.eta->seconds_per_rendered_frame);
    eta->set_measured_rendered_frames(progress.eta->measured_rendered_frames);
  }
  if (progress.queue_position) message.set_queue_position(*progress.queue_position);
  return message;
}

v1::Job Encode(const JobView& job, JobDetail detail) {
  const JobRecord& record = job.record;
  v1::Job message;
  if (!record.id.empty()) message.set_name(JobName(record.id));  // one that is only validated has none
  message.set_display_name(record.display_name);
  message.set_sequence(SequenceName(record.sequence_id));
  if (detail == JobDetail::kFull) {
    if (record.kind == JobKind::kUpsample) {
      ReadDocument(record.options, message.mutable_options());
    } else {
      ReadDocument(record.options, message.mutable_scene_flow_options());
    }
    for (const RenderRecord& render : record.renders) {
      v1::RenderOptions* added = message.add_renders();
      ReadDocument(render.options, added);
      added->set_name(render.name);
    }
  }
  message.set_threads(record.threads);
  message.set_priority(record.priority);
  if (record.limits.queue > absl::ZeroDuration()) *message.mutable_queue_time_limit() = Encode(record.limits.queue);
  if (record.limits.run > absl::ZeroDuration()) *message.mutable_run_time_limit() = Encode(record.limits.run);
  message.set_pinned(record.pinned);
  if (job.expire_time != absl::InfiniteFuture()) *message.mutable_expire_time() = Encode(job.expire_time);
  if (!record.depth_from.empty()) message.set_depth_from(JobName(record.depth_from));
  message.set_state(Encode(record.state));
  message.set_attempt(record.attempt);
  if (!record.error.ok()) {
    *message.mutable_error() = ToRpcStatus(record.error, {.subject = message.name(), .request_id = {}});
  }
  *message.mutable_progress() = Encode(job.progress);
  if (!record.id.empty()) *message.mutable_create_time() = Encode(record.create_time);
  if (record.start_time != absl::InfiniteFuture()) *message.mutable_start_time() = Encode(record.start_time);
  if (record.end_time != absl::InfiniteFuture()) *message.mutable_end_time() = Encode(record.end_time);
  if (record.self_check) *message.mutable_self_check() = Encode(*record.self_check);
  if (record.clock_estimate) *message.mutable_clock_estimate() = Encode(*record.clock_estimate);
  for (const std::string& warning : record.warnings) message.add_warnings(warning);
  if (record.webhook) *message.mutable_webhook() = Encode(*record.webhook);
  return message;
}

v1::Limits Encode(const Limits& limits, double max_calls_per_second) {
  v1::Limits message;
  message.set_max_sequence_bytes(limits.max_sequence_bytes);
  message.set_max_files_per_sequence(limits.max_files_per_sequence);
  message.set_max_files_per_upload(limits.max_files_per_upload);
  message.set_max_chunk_bytes(limits.max_chunk_bytes);
  message.set_max_queued_jobs(limits.max_queued_jobs);
  message.set_max_tenant_bytes(limits.max_tenant_bytes);
  message.set_max_tenant_queued_jobs(limits.max_tenant_queued_jobs);
  message.set_max_tenant_tasks(limits.max_tenant_tasks);
  message.set_max_tenant_uploads(limits.max_tenant_uploads);
  message.set_max_calls_per_second(max_calls_per_second);
  return message;
}

v1::JobEvent Encode(const JobEvent& event) {
  v1::JobEvent message;
  message.set_number(event.number);
  message.set_resume_token(event.resume_token);
  switch (event.kind) {
    case JobEvent::Kind::kSnapshot:
      *message.mutable_snapshot() = Encode(event.job);
      break;
    case JobEvent::Kind::kState: {
      v1::Job job = Encode(event.job);
      v1::JobEvent::StateChange* change = message.mutable_state_change();
      change->set_state(job.state());
      change->set_attempt(job.attempt());
      if (job.has_error()) change->mutable_error()->Swap(job.mutable_error());
      change->mutable_progress()->Swap(job.mutable_progress());
      if (job.has_self_check()) change->mutable_self_check()->Swap(job.mutable_self_check());
      if (job.has_clock_estimate()) change->mutable_clock_estimate()->Swap(job.mutable_clock_estimate());
      change->mutable_warnings()->Swap(job.mutable_warnings());
      break;
    }
    case JobEvent::Kind::kProgress:
      *message.mutable_progress() = Encode(event.job.progress);
      break;
    case JobEvent::Kind::kFramesReady: {
      v1::JobEvent::FramesReady* frames = message.mutable_frames_ready();
      frames->set_first_frame(event.first_frame);
      frames->set_frame_count(event.frame_count);
      frames->set_render(event.render);
      *frames->mutable_progress() = Encode(event.job.progress);
      break;
    }
  }
  return message;
}

}  // namespace depthtween::server
