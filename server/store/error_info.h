// A machine-readable reason on a Status: what the RPC layer turns into google.rpc.ErrorInfo.
#ifndef DEPTHTWEEN_SERVER_STORE_ERROR_INFO_H_
#define DEPTHTWEEN_SERVER_STORE_ERROR_INFO_H_

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "absl/strings/string_view.h"
#include "core/base/status.h"

namespace depthtween::server {

// Reasons in use, with their code and metadata:
//   IDEMPOTENCY_MISMATCH   AlreadyExists        request_id
//   DUPLICATE_PATH         AlreadyExists        path
//   OFFSET_MISMATCH        OutOfRange           committed_size
//   CHECKSUM_MISMATCH      DataLoss             committed_size, and path where a file's sha256 is meant
//   TAKEN_OVER             Aborted              upload
//   LIMIT_EXCEEDED         ResourceExhausted    limit (the field of Limits), maximum
//   DISK_FULL              ResourceExhausted
//   WRONG_STATE            FailedPrecondition   state
//   BAD_FIELD              InvalidArgument      field
//   BAD_MESSAGE            InvalidArgument
//   FRAME_NOT_READY        FailedPrecondition   frame
//   NO_DEPTH               FailedPrecondition   resource
//   NO_WEBHOOKS            FailedPrecondition
//   NO_SCENE_FLOW          FailedPrecondition   resource (the sequence that cannot give it)
//   SEQUENCE_GONE          FailedPrecondition   resource
//   NO_SUCH_FRAME          OutOfRange           frame_count
//   FILE_LOST              DataLoss             resource (output, job or sequence), and frame if it is of one
//   FILE_DAMAGED           DataLoss             resource, and frame, as FILE_LOST; file (relative to the data folder)
//   TIME_LIMIT             DeadlineExceeded     limit ("queue_time_limit" or "run_time_limit"), seconds
//   SERVER_BUSY            ResourceExhausted
//   SERVER_STOPPING        Unavailable
//   NO_SUCH_RESOURCE       NotFound             resource ("sequences/...", "jobs/...")
struct ErrorInfo {
  std::string reason;
  std::map<std::string, std::string> metadata;
};

// Debian's Abseil has a string_view of its own, which does not take one of the standard library.
inline absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

// `status` carrying `info`; replaces an earlier one. OK stays OK.
absl::Status WithErrorInfo(absl::Status status, const ErrorInfo& info);
// nullopt when the status carries none.
std::optional<ErrorInfo> GetErrorInfo(const absl::Status& status);

// The errors that several places make. `field` is a path in the request, such as "job.options.method".
absl::Status BadField(std::string_view field, std::string_view message);
// BadField with the message "field why".
absl::Status InvalidField(std::string_view field, std::string_view why);
absl::Status NoSuchResource(std::string_view resource);
absl::Status WrongState(std::string_view state, std::string_view message);
absl::Status LimitExceeded(std::string_view limit, int64_t maximum, std::string_view message);
absl::Status DiskFull(std::string_view message);
absl::Status ServerStopping();
// The client may retry soon.
absl::Status ServerBusy(std::string_view why);
// A file of an output is lost; `frame` < 0: the output is one file.
absl::Status FileLost(std::string_view output, int frame = -1);
// A file that a job keeps beside its outputs is lost: `what` is "motion".
absl::Status FileOfJobLost(std::string_view job, std::string_view what, int frame);

// A file whose bytes are no longer those that were stored. `resource` is what a client knows it by: an output, a job or
// a sequence; `file` is its path in the data folder; `frame` < 0: it is of no single frame.
absl::Status FileDamaged(std::string_view resource, std::string_view file, int frame = -1);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_ERROR_INFO_H_
