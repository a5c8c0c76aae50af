// depthtween.v1.OutputService: what jobs have made, read from their result folders.
#ifndef DEPTHTWEEN_SERVER_RPC_OUTPUT_SERVICE_H_
#define DEPTHTWEEN_SERVER_RPC_OUTPUT_SERVICE_H_

#include <grpcpp/impl/service_type.h>

#include <cstdint>
#include <memory>

#include "server/jobs/job_manager.h"
#include "server/rpc/call_runtime.h"

namespace depthtween::server {

// Borrows `runtime` and `jobs`. Streams of frames whose buffers together would exceed `frame_memory_bytes` are refused
// with ServerBusy().
std::unique_ptr<grpc::Service> MakeOutputService(CallRuntime& runtime, JobManager& jobs, const Guard& guard,
                                                 int64_t frame_memory_bytes);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_OUTPUT_SERVICE_H_
