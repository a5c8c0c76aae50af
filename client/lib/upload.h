// Sends a recording to a server, and resumes at the byte where an earlier try stopped.
#ifndef DEPTHTWEEN_CLIENT_LIB_UPLOAD_H_
#define DEPTHTWEEN_CLIENT_LIB_UPLOAD_H_

#include <cstdint>
#include <functional>

#include "client/lib/connection.h"
#include "client/lib/local_sequence.h"

namespace depthtween::client {

struct UploadProgress {
  int64_t bytes_done = 0;   // on the server, or handed to the connection
  int64_t bytes_found = 0;  // of these, were there before this call
  int64_t bytes_total = 0;
};

// Creates the sequence on the server, sends what is missing, and commits. The sequence's fingerprint is the request id,
// so that a later call, from another process too, resumes where the last one stopped, and sends nothing when everything
// is there. `sequence` must be hashed. `on_progress` may be empty. Errors: those of the server, which name the file;
// DataLoss when a file does not arrive as it was hashed, because it changed or the connection damaged it; Unavailable
// when the server was unreachable for longer than the connection's patience.
absl::StatusOr<v1::Sequence> UploadSequence(Connection& connection, const LocalSequence& sequence,
                                            const std::function<void(const UploadProgress&)>& on_progress);

// Waits until a committed sequence is READY or INVALID, and returns it. `on_progress` may be empty.
absl::StatusOr<v1::Sequence> AwaitValidation(Connection& connection, const std::string& name,
                                             const std::function<void(const v1::Sequence&)>& on_progress);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_UPLOAD_H_
