// A job's progress in words: only what has been measured.
#ifndef DEPTHTWEEN_CLIENT_CLI_JOB_PROGRESS_H_
#define DEPTHTWEEN_CLIENT_CLI_JOB_PROGRESS_H_

#include <string>

#include "client/lib/connection.h"
#include "client/lib/fetch.h"

namespace depthtween::cli {

// "frame 17 of 66, interval 2 of 8, picture 8 of 132, flow, 0:04 left", "queued, 2 jobs ahead", "succeeded, 66 frames".
std::string DescribeProgress(const v1::Job& job);

// Why a job FAILED, in one line; empty if it did not.
std::string DescribeFailure(const v1::Job& job);

// The options that differ from the defaults, as flags of `depthtween submit` or `sceneflow`, in one line; empty if
// there are none.
std::string DescribeOptions(const v1::Job& job);

// Measurements of the recording itself, as lines for people: the self-check, the clock. Empty if there are none.
std::string DescribeMeasured(const v1::Job& job);

// Follows a job until it has ended, with a progress line on stderr. Prints measurements there as they arrive.
absl::StatusOr<v1::Job> WatchWithProgressLine(client::Connection& connection, const std::string& name);

// Fetches a result with a progress line on stderr.
absl::StatusOr<client::FetchSummary> FetchWithProgressLine(client::Connection& connection, const std::string& job,
                                                           const std::string& directory,
                                                           const client::FetchOptions& options);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_JOB_PROGRESS_H_
