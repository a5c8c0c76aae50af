// depthtween.v1.SequenceService: decode, call Sequences, encode.
#ifndef DEPTHTWEEN_SERVER_RPC_SEQUENCE_SERVICE_H_
#define DEPTHTWEEN_SERVER_RPC_SEQUENCE_SERVICE_H_

#include <grpcpp/impl/service_type.h>

#include <memory>

#include "server/jobs/job_manager.h"
#include "server/jobs/sequences.h"
#include "server/rpc/call_runtime.h"
#include "server/store/limits.h"

namespace depthtween::server {

// Borrows everything but `limits`.
std::unique_ptr<grpc::Service> MakeSequenceService(CallRuntime& runtime, Sequences& sequences, JobManager& jobs,
                                                   const LiveLimits& limits);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_SEQUENCE_SERVICE_H_
