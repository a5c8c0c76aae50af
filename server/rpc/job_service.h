// depthtween.v1.JobService: decode, call JobManager, encode.
#ifndef DEPTHTWEEN_SERVER_RPC_JOB_SERVICE_H_
#define DEPTHTWEEN_SERVER_RPC_JOB_SERVICE_H_

#include <grpcpp/impl/service_type.h>

#include <memory>

#include "absl/time/time.h"
#include "server/jobs/job_manager.h"
#include "server/rpc/call_runtime.h"
#include "server/store/limits.h"

namespace depthtween::server {

// Borrows everything but `limits`. A watcher without news gets a heartbeat every `heartbeat`.
std::unique_ptr<grpc::Service> MakeJobService(CallRuntime& runtime, JobManager& jobs, const LiveLimits& limits,
                                              absl::Duration heartbeat);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_JOB_SERVICE_H_
