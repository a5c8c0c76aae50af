// WriteUpload: bytes from a client into an UploadWriter, one message at a time, so that a fast sender waits for the
// disk. Messages are decoded here: to gRPC 1.51 one that cannot be is the end of the stream, and no error.
#ifndef DEPTHTWEEN_SERVER_RPC_UPLOAD_STREAM_H_
#define DEPTHTWEEN_SERVER_RPC_UPLOAD_STREAM_H_

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include "server/jobs/sequences.h"
#include "server/rpc/call_runtime.h"

namespace depthtween::server {

// Answers one WriteUpload with an encoded v1::Upload. What arrived whole is kept, however the stream ends.
grpc::ServerReadReactor<grpc::ByteBuffer>* ReceiveUpload(CallRuntime& runtime, grpc::CallbackServerContext* context,
                                                         Sequences& sequences, grpc::ByteBuffer* response);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_UPLOAD_STREAM_H_
