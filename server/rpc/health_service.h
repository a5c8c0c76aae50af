// grpc.health.v1.Health, compiled here rather than gRPC's built-in one, so that reflection shows it.
#ifndef DEPTHTWEEN_SERVER_RPC_HEALTH_SERVICE_H_
#define DEPTHTWEEN_SERVER_RPC_HEALTH_SERVICE_H_

#include <grpcpp/impl/service_type.h>

#include <memory>

#include "server/rpc/call_runtime.h"
#include "server/telemetry/health.h"

namespace depthtween::server {

// Borrows both.
std::unique_ptr<grpc::Service> MakeHealthService(CallRuntime& runtime, Health& health);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_HEALTH_SERVICE_H_
