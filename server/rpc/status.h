// The one place where an absl::Status becomes what goes over the wire.
//
// Codes are the same on both sides. The details always hold google.rpc.ErrorInfo (domain "depthtween"; reason and
// metadata from store/error_info.h, or the code's name), and what else the error calls for:
//   INVALID_ARGUMENT      BadRequest, if the field is known
//   NOT_FOUND             ResourceInfo
//   FAILED_PRECONDITION   PreconditionFailure
//   RESOURCE_EXHAUSTED    QuotaFailure, and RetryInfo where waiting helps
//   UNAVAILABLE           RetryInfo
//   any, for a call       RequestInfo
//
// Reasons that arise here, beside those of store/error_info.h, with their metadata:
//   SERVER_STOPPING            UNAVAILABLE
//   NOT_FRAMES, NOT_A_FILE     FAILED_PRECONDITION   resource
//   BEYOND_END                 OUT_OF_RANGE          size_bytes
//   JOB_FAILED, JOB_CANCELLED  ABORTED               resource, next_frame
#ifndef DEPTHTWEEN_SERVER_RPC_STATUS_H_
#define DEPTHTWEEN_SERVER_RPC_STATUS_H_

#include <grpcpp/support/status.h>

#include <string>
#include <string_view>

#include "core/base/status.h"
#include "google/rpc/status.pb.h"
#include "server/store/error_info.h"

namespace depthtween::server {

inline constexpr char kErrorDomain[] = "depthtween";

// The call an error answers.
struct CallNames {
  std::string subject;     // the resource it is about, or empty
  std::string request_id;  // or empty
};

// For errors that are part of a message. OK gives an empty Status.
google::rpc::Status ToRpcStatus(const absl::Status& status, const CallNames& names = {});
// For the answer of a call.
grpc::Status ToGrpcStatus(const absl::Status& status, const CallNames& names = {});

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_STATUS_H_
