// Errors of the client as absl::Status: what the server answered, put into words, and what failed on this machine.
//
// Codes keep the server's meaning (see the protos); Unavailable always means that the server cannot be reached.
#ifndef DEPTHTWEEN_CLIENT_LIB_STATUS_H_
#define DEPTHTWEEN_CLIENT_LIB_STATUS_H_

#include <grpcpp/support/status.h>

#include <optional>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/status.h"
#include "google/rpc/status.pb.h"

namespace depthtween::client {

// The status of a call. Field violations that the server sent as details and did not put into its message are appended.
absl::Status FromRpc(const grpc::Status& status);

// Whether the same call may succeed a little later: the server is unreachable, stopping or busy.
bool IsTransient(const absl::Status& status);

// Whether the server has lost what was asked for, or its bytes are damaged: asking again does not help.
bool IsLost(const absl::Status& status);
// The lost frame, of an output that is made of frames; otherwise nullopt.
std::optional<int> LostFrame(const absl::Status& status);

// The status inside a message: of a violation, of a failed job.
absl::Status FromProto(const google::rpc::Status& status);

// The status of a failed system call. `what` says what was being done to which file.
absl::Status ErrnoStatus(int error_number, std::string_view what);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_STATUS_H_
