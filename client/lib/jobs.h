// Orders a job, and follows it until it ends.
#ifndef DEPTHTWEEN_CLIENT_LIB_JOBS_H_
#define DEPTHTWEEN_CLIENT_LIB_JOBS_H_

#include <functional>
#include <string>

#include "client/lib/connection.h"

namespace depthtween::client {

// Whether a job in this state will do no more of itself.
bool HasEnded(v1::Job::State state);

// OK for a job that SUCCEEDED; its error if it FAILED; Cancelled; FailedPrecondition while it has not ended.
absl::Status Outcome(const v1::Job& job);

absl::StatusOr<v1::Job> GetJob(Connection& connection, const std::string& name);

// Queues the job, or finds the one that the same sequence and options made before. One that FAILED or was CANCELLED is
// queued again, and keeps the intervals it has finished.
absl::StatusOr<v1::Job> SubmitJob(Connection& connection, const v1::Job& job);

// Follows a job until it has ended, across restarts of the server, and returns it. `on_event` is told every event and
// the job as it then is; may be empty.
absl::StatusOr<v1::Job> WatchJob(Connection& connection, const std::string& name,
                                 const std::function<void(const v1::JobEvent&, const v1::Job&)>& on_event);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_JOBS_H_
