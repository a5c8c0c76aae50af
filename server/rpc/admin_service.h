// depthtween.v1.AdminService: the server about itself, and what its operator may tell it to do.
#ifndef DEPTHTWEEN_SERVER_RPC_ADMIN_SERVICE_H_
#define DEPTHTWEEN_SERVER_RPC_ADMIN_SERVICE_H_

#include <grpcpp/impl/service_type.h>

#include <memory>

#include "server/access/guard.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/upkeep.h"
#include "server/rpc/call_runtime.h"
#include "server/store/limits.h"
#include "server/telemetry/health.h"

namespace depthtween::server {

// Borrows everything.
std::unique_ptr<grpc::Service> MakeAdminService(CallRuntime& runtime, JobManager& jobs, Upkeep& upkeep, Guard& guard,
                                                LiveLimits& limits, Health& health);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_ADMIN_SERVICE_H_
