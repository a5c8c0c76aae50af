#include "server/rpc/admin_service.h"

#include <algorithm>
#include <string>
#include <vector>

#include "depthtween/v1/admin.grpc.pb.h"
#include "server/rpc/encode.h"
#include "server/store/resource_names.h"
#include "server/telemetry/metrics.h"

namespace depthtween::server {
namespace {

using grpc::CallbackServerContext;
using grpc::ServerUnaryReactor;

v1::Collected::Reason Encode(CollectReason reason) {
  switch (reason) {
    case CollectReason::kExpired:
      return v1::Collected::REASON_EXPIRED;
    case CollectReason::kAbandoned:
      return v1::Collected::REASON_ABANDONED;
    case CollectReason::kDiskPressure:
      return v1::Collected::REASON_DISK_PRESSURE;
  }
  return v1::Collected::REASON_UNSPECIFIED;
}

v1::Scrub Encode(const ScrubState& scrub) {
  v1::Scrub message;
  message.set_running(scrub.running);
  if (scrub.start_time != absl::InfinitePast()) *message.mutable_start_time() = server::Encode(scrub.start_time);
  message.set_files_checked(scrub.files_checked);
  message.set_damaged_files(scrub.damaged_files);
  return message;
}

class AdminService : public v1::AdminService::CallbackService {
 public:
  AdminService(CallRuntime& runtime, JobManager& jobs, Upkeep& upkeep, Guard& guard, LiveLimits& limits, Health& health)
      : runtime_(runtime), jobs_(jobs), upkeep_(upkeep), guard_(guard), limits_(limits), health_(health) {}

  ServerUnaryReactor* GetServerInfo(CallbackServerContext* context, const v1::GetServerInfoRequest* request,
                                    v1::ServerInfo* response) override {
    return runtime_.Unary(context, "GetServerInfo", "", [=, this](const Caller&) {
      response->set_version(DEPTHTWEEN_VERSION);
      response->set_workers(jobs_.workers());
      *response->mutable_limits() = Encode(limits_.Get(), guard_.max_calls_per_second());
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* GetMetrics(CallbackServerContext* context, const v1::GetMetricsRequest* request,
                                 v1::Metrics* response) override {
    return runtime_.Unary(context, "GetMetrics", "", [=, this](const Caller&) -> absl::Status {
      ASSIGN_OR_RETURN(Gauges gauges, jobs_.Measure());
      gauges.ready = health_.IsServing("").value_or(false);
      response->set_text(MetricsText(gauges));
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* GetLimits(CallbackServerContext* context, const v1::GetLimitsRequest* request,
                                v1::Limits* response) override {
    return runtime_.Unary(context, "GetLimits", "", [=, this](const Caller&) {
      *response = Encode(limits_.Get(), guard_.max_calls_per_second());
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* UpdateLimits(CallbackServerContext* context, const v1::UpdateLimitsRequest* request,
                                   v1::Limits* response) override {
    return runtime_.Unary(context, "UpdateLimits", "", [=, this](const Caller&) -> absl::Status {
      const v1::Limits& wanted = request->limits();
      Limits limits = limits_.Get();
      if (wanted.has_max_sequence_bytes()) limits.max_sequence_bytes = wanted.max_sequence_bytes();
      if (wanted.has_max_files_per_sequence()) limits.max_files_per_sequence = wanted.max_files_per_sequence();
      if (wanted.has_max_files_per_upload()) limits.max_files_per_upload = wanted.max_files_per_upload();
      if (wanted.has_max_chunk_bytes()) limits.max_chunk_bytes = wanted.max_chunk_bytes();
      if (wanted.has_max_queued_jobs()) limits.max_queued_jobs = wanted.max_queued_jobs();
      if (wanted.has_max_tenant_bytes()) limits.max_tenant_bytes = wanted.max_tenant_bytes();
      if (wanted.has_max_tenant_queued_jobs()) limits.max_tenant_queued_jobs = wanted.max_tenant_queued_jobs();
      if (wanted.has_max_tenant_tasks()) limits.max_tenant_tasks = wanted.max_tenant_tasks();
      if (wanted.has_max_tenant_uploads()) limits.max_tenant_uploads = wanted.max_tenant_uploads();
      RETURN_IF_ERROR(limits.Validate());
      if (wanted.has_max_calls_per_second()) {
        RETURN_IF_ERROR(guard_.SetMaxCallsPerSecond(wanted.max_calls_per_second()));
      }
      RETURN_IF_ERROR(limits_.Set(limits));
      jobs_.Wake();  // a tenant may have more tasks now
      *response = Encode(limits, guard_.max_calls_per_second());
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* ListWorkers(CallbackServerContext* context, const v1::ListWorkersRequest* request,
                                  v1::ListWorkersResponse* response) override {
    return runtime_.Unary(context, "ListWorkers", "", [=, this](const Caller&) {
      const std::vector<RunningTask> tasks = jobs_.RunningTasks();
      for (const RunningTask& running : tasks) {
        const Task& task = running.task;
        v1::Worker* worker = response->add_workers();
        worker->set_task(task.number);
        worker->set_kind(std::string(ToString(task.kind)));
        worker->set_resource(task.job_id.empty() ? SequenceName(task.sequence_id) : JobName(task.job_id));
        worker->set_tenant(running.tenant);
        worker->set_failures(task.failures);
        worker->set_first_interval(task.first_interval);
        worker->set_interval_count(task.interval_count);
        *worker->mutable_start_time() = server::Encode(running.start_time);
      }
      response->set_idle_workers(std::max(0, jobs_.workers() - static_cast<int>(tasks.size())));
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* Drain(CallbackServerContext* context, const v1::DrainRequest* request,
                            v1::DrainState* response) override {
    return SetDraining(context, "Drain", true, response);
  }

  ServerUnaryReactor* Resume(CallbackServerContext* context, const v1::ResumeRequest* request,
                             v1::DrainState* response) override {
    return SetDraining(context, "Resume", false, response);
  }

  ServerUnaryReactor* CollectGarbage(CallbackServerContext* context, const v1::CollectGarbageRequest* request,
                                     v1::CollectGarbageResponse* response) override {
    return runtime_.Unary(context, "CollectGarbage", "", [=, this](const Caller&) -> absl::Status {
      ASSIGN_OR_RETURN(const std::vector<Collected> collected, upkeep_.collector().Collect(request->dry_run()));
      int64_t bytes = 0;
      for (const Collected& one : collected) {
        v1::Collected* added = response->add_collected();
        added->set_resource(one.resource);
        added->set_tenant(one.tenant);
        added->set_reason(Encode(one.reason));
        *added->mutable_since() = server::Encode(one.since);
        added->set_size_bytes(one.bytes);
        bytes += one.bytes;
      }
      response->set_size_bytes(bytes);
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* StartScrub(CallbackServerContext* context, const v1::StartScrubRequest* request,
                                 v1::Scrub* response) override {
    return runtime_.Unary(context, "StartScrub", "", [=, this](const Caller&) -> absl::Status {
      upkeep_.StartScrub();
      return ReadScrub(response);
    });
  }

  ServerUnaryReactor* GetScrub(CallbackServerContext* context, const v1::GetScrubRequest* request,
                               v1::Scrub* response) override {
    return runtime_.Unary(context, "GetScrub", "", [=, this](const Caller&) { return ReadScrub(response); });
  }

 private:
  absl::Status ReadScrub(v1::Scrub* response) {
    ASSIGN_OR_RETURN(const ScrubState scrub, upkeep_.GetScrub());
    *response = Encode(scrub);
    return absl::OkStatus();
  }

  ServerUnaryReactor* SetDraining(CallbackServerContext* context, std::string_view method, bool draining,
                                  v1::DrainState* response) {
    return runtime_.Unary(context, method, "", [=, this](const Caller&) {
      health_.Hold("draining", draining);
      jobs_.SetDraining(draining);
      response->set_draining(draining);
      response->set_running_tasks(static_cast<int>(jobs_.RunningTasks().size()));
      return absl::OkStatus();
    });
  }

  CallRuntime& runtime_;
  JobManager& jobs_;
  Upkeep& upkeep_;
  Guard& guard_;
  LiveLimits& limits_;
  Health& health_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeAdminService(CallRuntime& runtime, JobManager& jobs, Upkeep& upkeep, Guard& guard,
                                                LiveLimits& limits, Health& health) {
  return std::make_unique<AdminService>(runtime, jobs, upkeep, guard, limits, health);
}

}  // namespace depthtween::server
