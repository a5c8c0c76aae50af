#include "server/rpc/job_service.h"

#include <optional>
#include <string>
#include <utility>

#include "absl/time/clock.h"
#include "depthtween/v1/job.grpc.pb.h"
#include "server/rpc/encode.h"
#include "server/rpc/server_stream.h"
#include "server/rpc/status.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

using grpc::CallbackServerContext;
using grpc::ServerUnaryReactor;

class JobWatchStream : public ServerStream<v1::JobEvent> {
 public:
  JobWatchStream(CallRuntime& runtime, CallbackServerContext* context, JobManager& jobs, absl::Duration heartbeat,
                 const v1::WatchJobRequest& request)
      : ServerStream(runtime, context, "WatchJob", request.name()),
        jobs_(jobs),
        heartbeat_(heartbeat),
        name_(request.name()),
        resume_token_(request.resume_token()) {
    last_.set_resume_token(resume_token_);
  }

 private:
  absl::StatusOr<Next> Produce() override {
    if (watch_ == nullptr) {
      ASSIGN_OR_RETURN(id_, ParseJobName("name", name_));
      ASSIGN_OR_RETURN(watch_, jobs_.Watch(tenant(), id_, resume_token_, Waker()));
    }
    if (ended_) return Next::kEnd;
    std::optional<JobEvent> event = watch_->Next();
    if (!event && !said_anything_) {
      // Resumed with nothing missed. If the job has ended, nothing will follow: send its state, and end.
      ASSIGN_OR_RETURN(const JobView job, jobs_.Get(tenant(), id_));
      if (HasEnded(job.record.state)) {
        ASSIGN_OR_RETURN(watch_, jobs_.Watch(tenant(), id_, /*resume_token=*/"", Waker()));
        event = watch_->Next();
      }
    }
    if (event) {
      said_anything_ = true;
      ended_ = HasEnded(event->job.record.state);
      message() = Encode(*event);
      last_.set_number(message().number());
      last_.set_resume_token(message().resume_token());
      next_heartbeat_ = absl::Now() + heartbeat_;
      return Next::kMessage;
    }
    if (watch_->Deleted()) return NoSuchResource(name_);
    if (absl::Now() >= next_heartbeat_) {
      message() = last_;
      message().mutable_heartbeat();
      next_heartbeat_ = absl::Now() + heartbeat_;
      return Next::kMessage;
    }
    WakeAt(next_heartbeat_);
    return Next::kWait;
  }

  void Release() override { watch_.reset(); }

  JobManager& jobs_;
  const absl::Duration heartbeat_;
  const std::string name_;
  const std::string resume_token_;
  std::string id_;
  std::unique_ptr<JobWatch> watch_;
  v1::JobEvent last_;  // number and resume_token of the event before, which heartbeats repeat
  absl::Time next_heartbeat_ = absl::Now() + heartbeat_;
  bool said_anything_ = false;
  bool ended_ = false;
};

class JobService : public v1::JobService::CallbackService {
 public:
  JobService(CallRuntime& runtime, JobManager& jobs, const LiveLimits& limits, absl::Duration heartbeat)
      : runtime_(runtime), jobs_(jobs), limits_(limits), heartbeat_(heartbeat) {}

  ServerUnaryReactor* CreateJob(CallbackServerContext* context, const v1::CreateJobRequest* request,
                                v1::Job* response) override {
    return runtime_.Unary(
        context, "CreateJob", request->job().sequence(), [=, this](const Caller& caller) -> absl::Status {
          ASSIGN_OR_RETURN(const NewJob job, Decode(request->job()));
          ASSIGN_OR_RETURN(const JobView view,
                           jobs_.Create(caller.tenant, job, request->request_id(), request->validate_only()));
          *response = Encode(view);
          return absl::OkStatus();
        });
  }

  ServerUnaryReactor* GetJob(CallbackServerContext* context, const v1::GetJobRequest* request,
                             v1::Job* response) override {
    return AboutOneJob(context, "GetJob", request->name(), &JobManager::Get, response);
  }

  ServerUnaryReactor* ListJobs(CallbackServerContext* context, const v1::ListJobsRequest* request,
                               v1::ListJobsResponse* response) override {
    return runtime_.Unary(context, "ListJobs", "", [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const JobFilter filter, ParseJobFilter(request->filter()));
      ASSIGN_OR_RETURN(const PageRequest page,
                       ParsePage(request->page_size(), request->page_token(), limits_.Get().max_page_size));
      const JobDetail detail = request->view() == v1::JOB_VIEW_FULL ? JobDetail::kFull : JobDetail::kBasic;
      return FillPage(page, response, [&](const PageRequest& some) -> absl::Status {
        ASSIGN_OR_RETURN(const Page<JobView> views, jobs_.List(caller.tenant, filter, some, detail));
        for (const JobView& view : views.items) *response->add_jobs() = Encode(view, detail);
        response->set_next_page_token(views.next_token);
        return absl::OkStatus();
      });
    });
  }

  ServerUnaryReactor* DeleteJob(CallbackServerContext* context, const v1::DeleteJobRequest* request,
                                google::protobuf::Empty* response) override {
    return runtime_.Unary(context, "DeleteJob", request->name(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string id, ParseJobName("name", request->name()));
      return jobs_.Delete(caller.tenant, id);
    });
  }

  ServerUnaryReactor* CancelJob(CallbackServerContext* context, const v1::CancelJobRequest* request,
                                v1::Job* response) override {
    return AboutOneJob(context, "CancelJob", request->name(), &JobManager::Cancel, response);
  }

  ServerUnaryReactor* RetryJob(CallbackServerContext* context, const v1::RetryJobRequest* request,
                               v1::Job* response) override {
    return AboutOneJob(context, "RetryJob", request->name(), &JobManager::Retry, response);
  }

  ServerUnaryReactor* PinJob(CallbackServerContext* context, const v1::PinJobRequest* request,
                             v1::Job* response) override {
    return Pin(context, "PinJob", request->name(), true, response);
  }

  ServerUnaryReactor* UnpinJob(CallbackServerContext* context, const v1::UnpinJobRequest* request,
                               v1::Job* response) override {
    return Pin(context, "UnpinJob", request->name(), false, response);
  }

  grpc::ServerWriteReactor<v1::JobEvent>* WatchJob(CallbackServerContext* context,
                                                   const v1::WatchJobRequest* request) override {
    return LaunchStream<JobWatchStream>(runtime_, context, jobs_, heartbeat_, *request);
  }

 private:
  ServerUnaryReactor* Pin(CallbackServerContext* context, std::string_view method, const std::string& name, bool pinned,
                          v1::Job* response) {
    return runtime_.Unary(context, method, name, [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string id, ParseJobName("name", name));
      ASSIGN_OR_RETURN(const JobView view, jobs_.Pin(caller.tenant, id, pinned));
      *response = Encode(view);
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* AboutOneJob(CallbackServerContext* context, std::string_view method, const std::string& name,
                                  absl::StatusOr<JobView> (JobManager::*ask)(const Tenant&, std::string_view),
                                  v1::Job* response) {
    return runtime_.Unary(context, method, name, [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string id, ParseJobName("name", name));
      ASSIGN_OR_RETURN(const JobView view, (jobs_.*ask)(caller.tenant, id));
      *response = Encode(view);
      return absl::OkStatus();
    });
  }

  CallRuntime& runtime_;
  JobManager& jobs_;
  const LiveLimits& limits_;
  const absl::Duration heartbeat_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeJobService(CallRuntime& runtime, JobManager& jobs, const LiveLimits& limits,
                                              absl::Duration heartbeat) {
  return std::make_unique<JobService>(runtime, jobs, limits, heartbeat);
}

}  // namespace depthtween::server
