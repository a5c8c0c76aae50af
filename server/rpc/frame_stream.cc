#include "server/rpc/frame_stream.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "server/rpc/encode.h"
#include "server/rpc/frame_encoding.h"
#include "server/rpc/status.h"
#include "server/store/error_info.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

constexpr int kFramesPerLookup = 64;  // one look into the store serves this many frames

}  // namespace

bool FrameMemory::Take(int64_t bytes) {
  if (taken_bytes_.fetch_add(bytes) + bytes <= limit_bytes_) return true;
  Give(bytes);
  return false;
}

FrameStream::FrameStream(CallRuntime& runtime, grpc::CallbackServerContext* context, JobManager& jobs,
                         FrameMemory& memory, const v1::StreamFramesRequest& request)
    : ServerStream(runtime, context, "StreamFrames", request.name()),
      jobs_(jobs),
      memory_(memory),
      request_(request),
      stride_(std::max(1, request.stride())),
      next_frame_(request.start_frame()) {}

FrameStream::~FrameStream() { memory_.Give(memory_taken_); }

absl::StatusOr<FrameStream::Next> FrameStream::Produce() {
  if (!output_) RETURN_IF_ERROR(Open());
  if (chunks_.empty()) {
    RETURN_IF_ERROR(CatchUp());
    ASSIGN_OR_RETURN(const std::optional<FrameRecord> frame, NextReady());
    if (!frame) return EndOrWait();
    RETURN_IF_ERROR(Load(*frame));
  }
  chunks_.Fill(message());
  return Next::kMessage;
}

absl::Status FrameStream::Open() {
  ASSIGN_OR_RETURN(const OutputIds ids, ParseOutputName("name", request_.name()));
  if (request_.start_frame() < 0) {
    return InvalidField("start_frame", absl::StrFormat("= %d, must be >= 0", request_.start_frame()));
  }
  if (request_.end_frame() != 0 && request_.end_frame() < request_.start_frame()) {
    return InvalidField("end_frame", absl::StrFormat("= %d, must be >= start_frame = %d, or 0 for all frames",
                                                     request_.end_frame(), request_.start_frame()));
  }
  if (request_.stride() < 0) {
    return InvalidField("stride", absl::StrFormat("= %d, must be >= 0 (0 means 1)", request_.stride()));
  }
  ASSIGN_OR_RETURN(const JobView job, jobs_.Get(tenant(), ids.job_id));
  job_ = job.record;
  job_id_ = ids.job_id;
  ASSIGN_OR_RETURN(const OutputSpec output, FindOutput(job_, ids.output_id));
  if (!output.frames) {
    return WithErrorInfo(
        absl::FailedPreconditionError(absl::StrFormat("%s is one file, use ReadOutput", request_.name())),
        {.reason = "NOT_FRAMES", .metadata = {{"resource", request_.name()}}});
  }
  const std::vector<v1::Encoding> encodings = EncodingsOf(output);
  encoding_ = request_.encoding() == v1::ENCODING_UNSPECIFIED ? encodings.front() : request_.encoding();
  if (std::find(encodings.begin(), encodings.end(), encoding_) == encodings.end()) {
    return InvalidField("encoding", absl::StrFormat("= %d, must be one that ListOutputs offers for %s",
                                                    static_cast<int>(encoding_), request_.name()));
  }
  const Camera& camera = job_.recording.camera;
  const int64_t bytes = FrameMemoryBytes(output, int64_t{camera.width} * camera.height);
  if (!memory_.Take(bytes))
    return ServerBusy("the open streams of frames leave no memory for another; try again later");
  memory_taken_ = bytes;
  if (request_.follow()) {
    ASSIGN_OR_RETURN(watch_, jobs_.Watch(tenant(), job_id_, /*resume_token=*/"", Waker()));
  }
  output_ = output;
  return absl::OkStatus();
}

absl::Status FrameStream::CatchUp() {
  if (watch_ == nullptr) return absl::OkStatus();
  while (const std::optional<JobEvent> event = watch_->Next()) job_ = event->job.record;
  if (watch_->Deleted()) return jobs_.Get(tenant(), job_id_).status();
  return absl::OkStatus();
}

absl::StatusOr<std::optional<FrameRecord>> FrameStream::NextReady() {
  if (AtEndFrame()) return std::nullopt;
  if (output_->assembled && job_.state != JobState::kSucceeded) return std::nullopt;
  while (!upcoming_.empty() && upcoming_.front().index < next_frame_) upcoming_.pop_front();
  if (upcoming_.empty()) {
    ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames,
                     jobs_.Frames(tenant(), job_id_, next_frame_, kFramesPerLookup, output_->render));
    for (const FrameRecord& frame : frames) {
      // Up to the first that is missing: frames leave in order.
      if (!frame.ready) break;
      upcoming_.push_back(frame);
    }
    if (upcoming_.empty()) return std::nullopt;
  }
  return upcoming_.front();
}

bool FrameStream::AtEndFrame() const { return request_.end_frame() != 0 && next_frame_ >= request_.end_frame(); }

absl::StatusOr<FrameStream::Next> FrameStream::EndOrWait() const {
  const int total = job_.frames_total;
  if (total > 0 && request_.start_frame() > total) {
    return WithErrorInfo(absl::OutOfRangeError(
                             absl::StrFormat("start_frame = %d, the job has %d frames", request_.start_frame(), total)),
                         {.reason = "NO_SUCH_FRAME", .metadata = {{"frame_count", std::to_string(total)}}});
  }
  if (!request_.follow() || AtEndFrame()) return Next::kEnd;
  if (!HasEnded(job_.state)) return Next::kWait;
  if (job_.state == JobState::kSucceeded) return Next::kEnd;
  const std::string state(ToString(job_.state));
  return WithErrorInfo(
      absl::AbortedError(absl::StrFormat("the job ended as %s before frame %d was made%s%s", state, next_frame_,
                                         job_.error.ok() ? "" : ": ", std::string(job_.error.message()))),
      {.reason = absl::StrCat("JOB_", state),
       .metadata = {{"resource", JobName(job_id_)}, {"next_frame", std::to_string(next_frame_)}}});
}

absl::Status FrameStream::Load(const FrameRecord& frame) {
  chunks_.Clear();  // the frame before was sent; there is memory for one
  absl::StatusOr<std::string> stored = ReadFile(jobs_.FrameFile(job_id_, *output_, frame.stem));
  if (absl::IsNotFound(stored.status())) {
    // If the job was deleted meanwhile, say so; otherwise a missing file is data loss.
    RETURN_IF_ERROR(jobs_.Get(tenant(), job_id_).status());
    // Not every frame has what is made at the end. Older jobs did not record which frames do.
    const bool has_none = output_->assembled && !frame.assembled.value_or(false);
    if (!has_none) return FileLost(request_.name(), frame.index);
    stored = std::string();
  }
  if (!stored.ok()) {
    LogError("cannot read a frame", {{"error", std::string(stored.status().message())}});
    return absl::Status(stored.status().code(), absl::StrFormat("frame %d cannot be read", frame.index));
  }
  ASSIGN_OR_RETURN(const std::optional<FileChecksum> checksum, jobs_.Checksum(job_id_, *output_, frame.stem));
  if (checksum && !Matches(*checksum, *stored)) {
    // A job that is being deleted says so itself.
    RETURN_IF_ERROR(jobs_.Get(tenant(), job_id_).status());
    return jobs_.Damaged(job_id_, *output_, frame.stem, frame.index);
  }
  const bool metric = output_->kind == OutputKind::kDepth || output_->kind == OutputKind::kUncertainty;
  const double units_per_metre = metric ? job_.recording.depth_scale : 0.0;
  absl::StatusOr<std::string> bytes = EncodeFrame(*std::move(stored), *output_, encoding_, units_per_metre);
  if (!bytes.ok()) return WithContext(bytes.status(), absl::StrFormat("stored frame %d", frame.index));
  next_frame_ = static_cast<int>(std::min<int64_t>(int64_t{frame.index} + stride_, std::numeric_limits<int>::max()));

  v1::FrameHeader header;
  header.set_time_ns(frame.time_ns);
  header.set_stem(frame.stem);
  header.set_encoding(encoding_);
  *header.mutable_camera() = Encode(job_.recording.camera);
  header.set_units_per_metre(units_per_metre);
  header.set_invalid_value(InvalidValueOf(output_->kind));
  chunks_.Load(frame.index, std::move(header), *std::move(bytes), next_frame_);
  return absl::OkStatus();
}

}  // namespace depthtween::server
