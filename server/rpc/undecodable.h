// Requests whose bytes are no message of their method.
//
// gRPC 1.51 answers them UNIMPLEMENTED, without a word and before a service of ours hears of them. Here they become
// calls like all others: guarded, counted, logged, and answered INVALID_ARGUMENT. Of methods with one request message;
// who reads a stream of them decodes each by itself (DecodeMessage).
#ifndef DEPTHTWEEN_SERVER_RPC_UNDECODABLE_H_
#define DEPTHTWEEN_SERVER_RPC_UNDECODABLE_H_

#include <google/protobuf/message_lite.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_interceptor.h>

#include <memory>

#include "core/base/status.h"
#include "server/rpc/call_runtime.h"

namespace depthtween::server {

// For the builder of a server. Borrows `runtime`.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> MakeUndecodableAnswers(CallRuntime& runtime);

// InvalidArgument, as those answers are. Leaves `bytes` empty.
absl::Status DecodeMessage(grpc::ByteBuffer& bytes, google::protobuf::MessageLite& message);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_UNDECODABLE_H_
