#include "server/rpc/frame_render_stream.h"

#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "server/rpc/encode.h"
#include "server/rpc/status.h"

namespace depthtween::server {

FrameRenderStream::FrameRenderStream(CallRuntime& runtime, grpc::CallbackServerContext* context, JobManager& jobs,
                                     const v1::RenderFrameRequest& request)
    : ServerStream(runtime, context, "RenderFrame", request.job()), jobs_(jobs), request_(request) {}

absl::StatusOr<FrameRenderStream::Next> FrameRenderStream::Produce() {
  if (errand_ == nullptr) RETURN_IF_ERROR(Begin());
  if (!answered_) {
    std::optional<absl::StatusOr<std::string>> answer = errand_->TakeAnswer();
    if (!answer) return Next::kWait;
    // If the job was deleted meanwhile, say so; otherwise a missing file is data loss.
    if (absl::IsDataLoss(answer->status())) RETURN_IF_ERROR(jobs_.Get(tenant(), job_id_).status());
    ASSIGN_OR_RETURN(std::string bytes, *std::move(answer));
    answered_ = true;
    chunks_.Load(request_.frame(), std::move(header_), std::move(bytes), request_.frame() + 1);
  }
  if (chunks_.empty()) return Next::kEnd;
  chunks_.Fill(message());
  return Next::kMessage;
}

absl::Status FrameRenderStream::Begin() {
  ASSIGN_OR_RETURN(job_id_, ParseJobName("job", request_.job()));
  if (request_.frame() < 0) {
    return InvalidField("frame", absl::StrFormat("= %d, must be >= 0", request_.frame()));
  }
  const v1::Encoding encoding =
      request_.encoding() == v1::ENCODING_UNSPECIFIED ? v1::ENCODING_PNG : request_.encoding();
  if (encoding != v1::ENCODING_PNG && encoding != v1::ENCODING_JPEG) {
    return InvalidField("encoding",
                        absl::StrFormat("= %d, must be PNG or JPEG for a picture", static_cast<int>(encoding)));
  }
  ASSIGN_OR_RETURN(std::string options, OptionsDocument("render", request_.render()));
  ASSIGN_OR_RETURN(const JobView job, jobs_.Get(tenant(), job_id_));
  const FrameRenderOrder order = {
      .frame = request_.frame(), .options = std::move(options), .jpeg = encoding == v1::ENCODING_JPEG};
  ASSIGN_OR_RETURN(errand_, jobs_.RenderFrame(tenant(), job_id_, order, Waker()));
  ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, jobs_.Frames(tenant(), job_id_, request_.frame(), 1));
  if (!frames.empty()) {
    header_.set_time_ns(frames[0].time_ns);
    header_.set_stem(frames[0].stem);
  }
  header_.set_encoding(encoding);
  *header_.mutable_camera() = Encode(job.record.recording.camera);
  return absl::OkStatus();
}

}  // namespace depthtween::server
