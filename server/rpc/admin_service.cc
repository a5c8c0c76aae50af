#include "server/rpc/admin_service.h"

#include "depthtween/v1/admin.grpc.pb.h"
#include "server/telemetry/metrics.h"

namespace depthtween::server {
namespace {

class AdminService : public v1::AdminService::CallbackService {
 public:
  AdminService(CallRuntime& runtime, JobManager& jobs, const Health& health, const Limits& limits)
      : runtime_(runtime), jobs_(jobs), health_(health), limits_(limits) {}

  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context, const v1::GetServerInfoRequest* request,
                                          v1::ServerInfo* response) override {
    return runtime_.Unary(context, "GetServerInfo", "", [=, this](const Caller&) {
      response->set_version(DEPTHTWEEN_VERSION);
      response->set_workers(jobs_.workers());
      v1::Limits* limits = response->mutable_limits();
      limits->set_max_sequence_bytes(limits_.max_sequence_bytes);
      limits->set_max_files_per_sequence(limits_.max_files_per_sequence);
      limits->set_max_files_per_upload(limits_.max_files_per_upload);
      limits->set_max_chunk_bytes(limits_.max_chunk_bytes);
      limits->set_max_queued_jobs(limits_.max_queued_jobs);
      return absl::OkStatus();
    });
  }

  grpc::ServerUnaryReactor* GetMetrics(grpc::CallbackServerContext* context, const v1::GetMetricsRequest* request,
                                       v1::Metrics* response) override {
    return runtime_.Unary(context, "GetMetrics", "", [=, this](const Caller&) -> absl::Status {
      ASSIGN_OR_RETURN(Gauges gauges, jobs_.Measure());
      gauges.ready = health_.IsServing("").value_or(false);
      response->set_text(MetricsText(gauges));
      return absl::OkStatus();
    });
  }

 private:
  CallRuntime& runtime_;
  JobManager& jobs_;
  const Health& health_;
  const Limits limits_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeAdminService(CallRuntime& runtime, JobManager& jobs, const Health& health,
                                                const Limits& limits) {
  return std::make_unique<AdminService>(runtime, jobs, health, limits);
}

}  // namespace depthtween::server
