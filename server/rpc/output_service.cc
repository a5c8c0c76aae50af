#include "server/rpc/output_service.h"

#include <cstdint>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "depthtween/v1/output.grpc.pb.h"
#include "server/rpc/encode.h"
#include "server/rpc/file_stream.h"
#include "server/rpc/frame_encoding.h"
#include "server/rpc/frame_render_stream.h"
#include "server/rpc/frame_stream.h"

namespace depthtween::server {
namespace {

using grpc::CallbackServerContext;

constexpr absl::Duration kLinkLife = absl::Hours(1);

int FramesReady(const JobRecord& job, const OutputSpec& output) {
  if (output.assembled) return job.state == JobState::kSucceeded ? job.frames_total : 0;
  return output.render < 0 ? job.frames_done : job.renders[output.render].frames_done;
}

class OutputService : public v1::OutputService::CallbackService {
 public:
  OutputService(CallRuntime& runtime, JobManager& jobs, const Guard& guard, int64_t frame_memory_bytes)
      : runtime_(runtime), jobs_(jobs), guard_(guard), frame_memory_(frame_memory_bytes) {}

  grpc::ServerUnaryReactor* ListOutputs(CallbackServerContext* context, const v1::ListOutputsRequest* request,
                                        v1::ListOutputsResponse* response) override {
    return runtime_.Unary(context, "ListOutputs", request->parent(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string job_id, ParseJobName("parent", request->parent()));
      ASSIGN_OR_RETURN(const JobView job, jobs_.Get(caller.tenant, job_id));
      for (const OutputSpec& spec : OutputsOf(job.record)) {
        v1::Output* output = response->add_outputs();
        output->set_name(OutputName(job_id, spec.id));
        output->set_file_name(spec.file_name);
        if (spec.frames) {
          output->set_kind(v1::Output::KIND_FRAMES);
          for (const v1::Encoding encoding : EncodingsOf(spec)) output->add_encodings(encoding);
          output->set_frames_ready(FramesReady(job.record, spec));
          output->set_frame_count(job.record.frames_total);
        } else {
          output->set_kind(v1::Output::KIND_FILE);
          if (job.record.state == JobState::kSucceeded) {
            std::error_code error;
            const uintmax_t size_bytes = std::filesystem::file_size(jobs_.OutputFile(job_id, spec), error);
            output->set_ready(!error);
            output->set_lost(static_cast<bool>(error));
            if (!error) output->set_size_bytes(static_cast<int64_t>(size_bytes));
          }
        }
      }
      return absl::OkStatus();
    });
  }

  grpc::ServerWriteReactor<v1::FrameChunk>* StreamFrames(CallbackServerContext* context,
                                                         const v1::StreamFramesRequest* request) override {
    return LaunchStream<FrameStream>(runtime_, context, jobs_, frame_memory_, *request);
  }

  grpc::ServerWriteReactor<v1::FrameChunk>* RenderFrame(CallbackServerContext* context,
                                                        const v1::RenderFrameRequest* request) override {
    return LaunchStream<FrameRenderStream>(runtime_, context, jobs_, *request);
  }

  grpc::ServerWriteReactor<v1::ReadOutputResponse>* ReadOutput(CallbackServerContext* context,
                                                               const v1::ReadOutputRequest* request) override {
    return LaunchStream<FileStream>(runtime_, context, jobs_, *request);
  }

  grpc::ServerUnaryReactor* CreateLink(CallbackServerContext* context, const v1::CreateLinkRequest* request,
                                       v1::Link* response) override {
    return runtime_.Unary(context, "CreateLink", request->name(), [=, this](const Caller& caller) -> absl::Status {
      const absl::Duration life = request->has_lifetime() ? absl::Seconds(request->lifetime().seconds()) : kLinkLife;
      if (life < absl::Seconds(1) || life > kMaxLinkLife) {
        return InvalidField("lifetime", absl::StrCat("= ", absl::FormatDuration(life), ", must be 1 s to 24 h"));
      }
      // The caller must see what the link will show.
      if (request->name().find("/outputs/") == std::string::npos) {
        ASSIGN_OR_RETURN(const std::string job_id, ParseJobName("name", request->name()));
        RETURN_IF_ERROR(jobs_.Get(caller.tenant, job_id).status());
      } else {
        ASSIGN_OR_RETURN(const OutputIds ids, ParseOutputName("name", request->name()));
        ASSIGN_OR_RETURN(const JobView job, jobs_.Get(caller.tenant, ids.job_id));
        RETURN_IF_ERROR(FindOutput(job.record, ids.output_id).status());
      }
      response->set_name(request->name());
      response->set_signature(guard_.SignLink(caller.tenant, request->name(), life));
      *response->mutable_expire_time() = Encode(absl::Now() + life);
      return absl::OkStatus();
    });
  }

 private:
  CallRuntime& runtime_;
  JobManager& jobs_;
  const Guard& guard_;
  FrameMemory frame_memory_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeOutputService(CallRuntime& runtime, JobManager& jobs, const Guard& guard,
                                                 int64_t frame_memory_bytes) {
  return std::make_unique<OutputService>(runtime, jobs, guard, frame_memory_bytes);
}

}  // namespace depthtween::server
