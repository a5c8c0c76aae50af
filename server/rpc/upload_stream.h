// WriteUpload: bytes from a client into an UploadWriter, one message at a time, so that a fast sender waits for the
// disk.
#ifndef DEPTHTWEEN_SERVER_RPC_UPLOAD_STREAM_H_
#define DEPTHTWEEN_SERVER_RPC_UPLOAD_STREAM_H_

#include <grpcpp/support/server_callback.h>

#include "depthtween/v1/sequence.pb.h"
#include "server/jobs/sequences.h"
#include "server/rpc/call_runtime.h"

namespace depthtween::server {

// Answers one WriteUpload. What arrived whole is kept, however the stream ends.
grpc::ServerReadReactor<v1::WriteUploadRequest>* ReceiveUpload(CallRuntime& runtime,
                                                               grpc::CallbackServerContext* context,
                                                               Sequences& sequences, v1::Upload* response);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_UPLOAD_STREAM_H_
