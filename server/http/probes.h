// What a load balancer, an orchestrator or Prometheus asks: is the process up, does it take work, what does it count.
#ifndef DEPTHTWEEN_SERVER_HTTP_PROBES_H_
#define DEPTHTWEEN_SERVER_HTTP_PROBES_H_

#include "server/http/calls.h"
#include "server/http/router.h"

namespace depthtween::server {

// GET /healthz   200 whenever this process answers at all
// GET /readyz    200 if grpc.health.v1 says SERVING, else 503; the body says which
// GET /metrics   AdminService.GetMetrics, the text alone: for tokens with the scope admin, where the server has tokens
// `channel` must outlive the router.
void AddProbes(Router& router, RpcChannel& channel);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_PROBES_H_
