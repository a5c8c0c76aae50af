#include "server/rpc/file_stream.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "absl/strings/str_format.h"
#include "proto/depthtween/crc32c.h"
#include "server/rpc/encode.h"
#include "server/rpc/status.h"
#include "server/store/error_info.h"
#include "server/telemetry/metrics.h"

namespace depthtween::server {
FileStream::FileStream(CallRuntime& runtime, grpc::CallbackServerContext* context, JobManager& jobs,
                       const v1::ReadOutputRequest& request)
    : ServerStream(runtime, context, "ReadOutput", request.name()), jobs_(jobs), request_(request) {}

FileStream::~FileStream() {
  if (descriptor_ >= 0) close(descriptor_);
}

absl::StatusOr<FileStream::Next> FileStream::Produce() {
  if (descriptor_ < 0) RETURN_IF_ERROR(Open());
  if (position_ == end_) return Next::kEnd;
  v1::ReadOutputResponse& chunk = message();
  std::string& data = *chunk.mutable_data();
  // A whole block, because only that can be checked; of the first and the last one a part may be wanted.
  const int64_t block = position_ / kChecksumBlockBytes, start = block * kChecksumBlockBytes;
  data.resize(static_cast<size_t>(std::min(kChecksumBlockBytes, size_bytes_ - start)));
  for (size_t filled = 0; filled < data.size();) {
    const ssize_t got =
        pread(descriptor_, data.data() + filled, data.size() - filled, start + static_cast<int64_t>(filled));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return ErrnoStatus(errno, absl::StrCat("read ", request_.name()));
    if (got == 0) {
      return absl::DataLossError(absl::StrFormat("%s became shorter than %d bytes", request_.name(), size_bytes_));
    }
    filled += static_cast<size_t>(got);
  }
  if (checksum_ && !BlockMatches(*checksum_, block, data)) return Damaged();
  data.resize(static_cast<size_t>(std::min(static_cast<int64_t>(data.size()), end_ - start)));
  data.erase(0, static_cast<size_t>(position_ - start));
  chunk.set_offset(position_);
  chunk.set_crc32c(Crc32c(data));
  chunk.set_size_bytes(size_bytes_);
  position_ += static_cast<int64_t>(data.size());
  CountBytes("out", static_cast<int64_t>(data.size()));
  return Next::kMessage;
}

absl::Status FileStream::Damaged() {
  RETURN_IF_ERROR(jobs_.Get(tenant(), job_id_).status());
  return jobs_.Damaged(job_id_, output_);
}

absl::Status FileStream::Open() {
  ASSIGN_OR_RETURN(const OutputIds ids, ParseOutputName("name", request_.name()));
  if (request_.read_offset() < 0) {
    return InvalidField("read_offset", absl::StrFormat("= %d, must be >= 0", request_.read_offset()));
  }
  if (request_.read_limit() < 0) {
    return InvalidField("read_limit", absl::StrFormat("= %d, must be >= 0 (0 means all)", request_.read_limit()));
  }
  ASSIGN_OR_RETURN(const JobView job, jobs_.Get(tenant(), ids.job_id));
  ASSIGN_OR_RETURN(const OutputSpec output, FindOutput(job.record, ids.output_id));
  if (output.frames) {
    return WithErrorInfo(
        absl::FailedPreconditionError(absl::StrFormat("%s is made of frames, use StreamFrames", request_.name())),
        {.reason = "NOT_A_FILE", .metadata = {{"resource", request_.name()}}});
  }
  if (job.record.state != JobState::kSucceeded) {
    const std::string state(ToString(job.record.state));
    return WithErrorInfo(absl::FailedPreconditionError(absl::StrFormat(
                             "%s can be read once the job has SUCCEEDED, it is %s", request_.name(), state)),
                         {.reason = "WRONG_STATE", .metadata = {{"state", state}, {"resource", JobName(ids.job_id)}}});
  }
  descriptor_ = open(jobs_.OutputFile(ids.job_id, output).c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor_ < 0 && errno == ENOENT) {
    RETURN_IF_ERROR(jobs_.Get(tenant(), ids.job_id).status());  // a job that is being deleted says so itself
    return FileLost(request_.name());
  }
  struct stat facts {};
  if (descriptor_ < 0 || fstat(descriptor_, &facts) != 0) {
    return ErrnoStatus(errno, absl::StrCat("open ", request_.name()));
  }
  size_bytes_ = facts.st_size;
  job_id_ = ids.job_id;
  output_ = output;
  ASSIGN_OR_RETURN(checksum_, jobs_.Checksum(job_id_, output_));
  if (checksum_ && checksum_->size_bytes != size_bytes_) return Damaged();
  if (request_.read_offset() > size_bytes_) {
    return WithErrorInfo(absl::OutOfRangeError(absl::StrFormat("read_offset = %d, the output has %d bytes",
                                                               request_.read_offset(), size_bytes_)),
                         {.reason = "BEYOND_END", .metadata = {{"size_bytes", std::to_string(size_bytes_)}}});
  }
  position_ = request_.read_offset();
  end_ =
      request_.read_limit() == 0 ? size_bytes_ : position_ + std::min(request_.read_limit(), size_bytes_ - position_);
  return absl::OkStatus();
}

}  // namespace depthtween::server
