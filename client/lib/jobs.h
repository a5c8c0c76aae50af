// Creates a job, and follows it until it ends.
#ifndef DEPTHTWEEN_CLIENT_LIB_JOBS_H_
#define DEPTHTWEEN_CLIENT_LIB_JOBS_H_

#include <functional>
#include <string>

#include "client/lib/connection.h"

namespace depthtween::client {

// Whether a job in this state has ended; only a retry changes it.
bool HasEnded(v1::Job::State state);

// OK for a job that SUCCEEDED; its error if it FAILED; Cancelled; FailedPrecondition while it has not ended.
absl::Status Outcome(const v1::Job& job);

absl::StatusOr<v1::Job> GetJob(Connection& connection, const std::string& name);

// Queues the job, or finds the earlier job of the same sequence and options. Queues that one again if it FAILED or was
// CANCELLED; it keeps its finished intervals.
absl::StatusOr<v1::Job> SubmitJob(Connection& connection, const v1::Job& job);

// Follows a job until it has ended, across restarts of the server, and returns it. `on_event` gets every event and the
// job after it; may be empty.
absl::StatusOr<v1::Job> WatchJob(Connection& connection, const std::string& name,
                                 const std::function<void(const v1::JobEvent&, const v1::Job&)>& on_event);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_JOBS_H_
