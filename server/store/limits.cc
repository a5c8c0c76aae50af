#include "server/store/limits.h"

#include "absl/strings/str_format.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

// One message carries a manifest or a chunk, with room for what is around it.
constexpr int kMostFilesPerUpload = 10'000;
constexpr int64_t kMostChunkBytes = 4'000'000;

absl::Status CheckLimit(std::string_view field, int64_t value, int64_t least, int64_t most) {
  if (value >= least && value <= most) return absl::OkStatus();
  const std::string name = "limits." + std::string(field);
  const std::string rule =
      most == INT64_MAX ? absl::StrFormat("at least %d", least) : absl::StrFormat("%d to %d", least, most);
  return BadField(name, absl::StrFormat("%s = %d, must be %s", name, value, rule));
}

}  // namespace

absl::Status Limits::Validate() const {
  RETURN_IF_ERROR(CheckLimit("max_sequence_bytes", max_sequence_bytes, 1, INT64_MAX));
  RETURN_IF_ERROR(CheckLimit("max_files_per_sequence", max_files_per_sequence, 1, INT64_MAX));
  RETURN_IF_ERROR(CheckLimit("max_files_per_upload", max_files_per_upload, 1, kMostFilesPerUpload));
  RETURN_IF_ERROR(CheckLimit("max_chunk_bytes", max_chunk_bytes, 1, kMostChunkBytes));
  RETURN_IF_ERROR(CheckLimit("max_queued_jobs", max_queued_jobs, 1, INT64_MAX));
  RETURN_IF_ERROR(CheckLimit("max_tenant_bytes", max_tenant_bytes, 0, INT64_MAX));
  RETURN_IF_ERROR(CheckLimit("max_tenant_queued_jobs", max_tenant_queued_jobs, 0, INT64_MAX));
  RETURN_IF_ERROR(CheckLimit("max_tenant_tasks", max_tenant_tasks, 0, INT64_MAX));
  return CheckLimit("max_tenant_uploads", max_tenant_uploads, 0, INT64_MAX);
}

Limits LiveLimits::Get() const {
  const std::lock_guard lock(mutex_);
  return limits_;
}

absl::Status LiveLimits::Set(const Limits& limits) {
  RETURN_IF_ERROR(limits.Validate());
  const std::lock_guard lock(mutex_);
  limits_ = limits;
  return absl::OkStatus();
}

}  // namespace depthtween::server
