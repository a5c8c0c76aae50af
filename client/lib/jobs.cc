#include "client/lib/jobs.h"

#include "absl/strings/str_cat.h"
#include "client/lib/backoff.h"
#include "proto/depthtween/sha256.h"

namespace depthtween::client {
namespace {

using Jobs = v1::JobService::StubInterface;

// A job as it is after `event`.
void Apply(const v1::JobEvent& event, v1::Job& job) {
  switch (event.event_case()) {
    case v1::JobEvent::kSnapshot:
      job = event.snapshot();
      break;
    case v1::JobEvent::kStateChange:
      job.set_state(event.state_change().state());
      job.set_attempt(event.state_change().attempt());
      job.clear_error();
      if (event.state_change().has_error()) *job.mutable_error() = event.state_change().error();
      *job.mutable_progress() = event.state_change().progress();
      if (event.state_change().has_self_check()) *job.mutable_self_check() = event.state_change().self_check();
      if (event.state_change().has_clock_estimate()) {
        *job.mutable_clock_estimate() = event.state_change().clock_estimate();
      }
      *job.mutable_warnings() = event.state_change().warnings();
      break;
    case v1::JobEvent::kProgress:
      *job.mutable_progress() = event.progress();
      break;
    case v1::JobEvent::kFramesReady:
      *job.mutable_progress() = event.frames_ready().progress();
      break;
    case v1::JobEvent::kHeartbeat:
    case v1::JobEvent::EVENT_NOT_SET:
      break;
  }
}

// Equal for equal orders only.
std::string RequestId(const v1::Job& job) {
  Sha256 id;
  id.Update(job.SerializeAsString());  // has no maps: the same order has the same bytes
  return Hex(id.Finish());
}

}  // namespace

bool HasEnded(v1::Job::State state) {
  return state == v1::Job::STATE_SUCCEEDED || state == v1::Job::STATE_FAILED || state == v1::Job::STATE_CANCELLED;
}

absl::Status Outcome(const v1::Job& job) {
  switch (job.state()) {
    case v1::Job::STATE_SUCCEEDED:
      return absl::OkStatus();
    case v1::Job::STATE_FAILED:
      return FromProto(job.error());
    case v1::Job::STATE_CANCELLED:
      return absl::CancelledError(absl::StrCat(job.name(), " was cancelled"));
    default:
      return absl::FailedPreconditionError(absl::StrCat(job.name(), " has not ended"));
  }
}

absl::StatusOr<v1::Job> GetJob(Connection& connection, const std::string& name) {
  v1::GetJobRequest request;
  request.set_name(name);
  return connection.Call(connection.jobs(), &Jobs::GetJob, request);
}

absl::StatusOr<v1::Job> SubmitJob(Connection& connection, const v1::Job& job) {
  v1::CreateJobRequest create;
  *create.mutable_job() = job;
  create.set_request_id(RequestId(job));
  ASSIGN_OR_RETURN(v1::Job made, connection.Call(connection.jobs(), &Jobs::CreateJob, create));
  if (made.state() != v1::Job::STATE_FAILED && made.state() != v1::Job::STATE_CANCELLED) return made;
  v1::RetryJobRequest retry;
  retry.set_name(made.name());
  absl::StatusOr<v1::Job> retried = connection.Call(connection.jobs(), &Jobs::RetryJob, retry);
  if (!absl::IsFailedPrecondition(retried.status())) return retried;
  // An earlier try may have succeeded and its answer been lost: then the job is queued already.
  ASSIGN_OR_RETURN(made, GetJob(connection, made.name()));
  if (made.state() == v1::Job::STATE_FAILED || made.state() == v1::Job::STATE_CANCELLED) return retried.status();
  return made;
}

absl::StatusOr<v1::Job> WatchJob(Connection& connection, const std::string& name,
                                 const std::function<void(const v1::JobEvent&, const v1::Job&)>& on_event) {
  v1::Job job;
  v1::WatchJobRequest request;
  request.set_name(name);
  for (Backoff backoff = connection.NewBackoff(); !HasEnded(job.state());) {
    grpc::ClientContext context;  // no deadline: heartbeats tell whether the server lives
    connection.Authorize(context);
    const auto stream = connection.jobs().WatchJob(&context, request);
    v1::JobEvent event;
    while (stream->Read(&event)) {
      backoff.Reset();
      Apply(event, job);
      request.set_resume_token(event.resume_token());
      if (on_event) on_event(event, job);
    }
    absl::Status status = connection.Answer(stream->Finish());
    if (!status.ok() && !IsTransient(status)) return status;
    if (status.ok()) status = absl::UnavailableError("the server ended the watch before the job ended");
    if (!HasEnded(job.state()) && !backoff.Wait(status)) return status;
  }
  // Events carry no times; the job itself has its end_time.
  return GetJob(connection, name);
}

}  // namespace depthtween::client
