// depthtween.v1.AdminService: the server about itself.
#ifndef DEPTHTWEEN_SERVER_RPC_ADMIN_SERVICE_H_
#define DEPTHTWEEN_SERVER_RPC_ADMIN_SERVICE_H_

#include <grpcpp/impl/service_type.h>

#include <memory>

#include "server/jobs/job_manager.h"
#include "server/rpc/call_runtime.h"
#include "server/store/limits.h"
#include "server/telemetry/health.h"

namespace depthtween::server {

// Borrows everything but `limits`.
std::unique_ptr<grpc::Service> MakeAdminService(CallRuntime& runtime, JobManager& jobs, const Health& health,
                                                const Limits& limits);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_ADMIN_SERVICE_H_
