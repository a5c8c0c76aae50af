// Every bound the server puts on what clients may ask of it, in one place.
#ifndef DEPTHTWEEN_SERVER_STORE_LIMITS_H_
#define DEPTHTWEEN_SERVER_STORE_LIMITS_H_

#include <cstdint>
#include <mutex>

#include "core/base/status.h"

#include "absl/time/time.h"

namespace depthtween::server {

struct Limits {
  int64_t max_sequence_bytes = 20'000'000'000;
  int max_files_per_sequence = 250'000;  // 100,000 frames of each kind, the three lists, and room for ground truth
  int max_files_per_upload = 10'000;     // keeps the manifest below the 4 MiB of one message
  int64_t max_chunk_bytes = 1 << 20;
  int max_queued_jobs = 1000;
  // Of one tenant; 0: no limit but those of the server.
  int64_t max_tenant_bytes = 0;  // recordings, uploaded or announced
  int max_tenant_queued_jobs = 0;
  int max_tenant_tasks = 0;    // that run at the same time
  int max_tenant_uploads = 0;  // begun and not finished
  int max_page_size = 1000;
  int max_display_name_bytes = 200;
  int max_request_id_bytes = 128;
  int max_upload_metadata_bytes = 4096;
  // A sequence that is still uploaded to is removed when no byte of it has come for so long; zero: never.
  absl::Duration keep_uploads = absl::Hours(7 * 24);
  // An upload is refused when it would leave less free than this: the database and running jobs need room to end well.
  int64_t reserved_disk_bytes = 256 << 20;

  // InvalidArgument with the field, its value and the rule.
  absl::Status Validate() const;
};

// The limits that hold now; an operator may change them while the server runs.
// Threads: all methods may be called concurrently.
class LiveLimits {
 public:
  explicit LiveLimits(const Limits& limits) : limits_(limits) {}

  Limits Get() const;
  // What has been accepted under other limits stays. As Limits::Validate; then nothing has changed.
  absl::Status Set(const Limits& limits);

 private:
  mutable std::mutex mutex_;
  Limits limits_;  // guarded by mutex_
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_LIMITS_H_
