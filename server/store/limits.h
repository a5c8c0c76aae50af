// Every bound the server puts on what clients may ask of it, in one place.
#ifndef DEPTHTWEEN_SERVER_STORE_LIMITS_H_
#define DEPTHTWEEN_SERVER_STORE_LIMITS_H_

#include <cstdint>

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
  int max_tenant_tasks = 0;  // that run at the same time
  int max_page_size = 1000;
  int max_display_name_bytes = 200;
  int max_request_id_bytes = 128;
  // An upload is refused when it would leave less free than this: the database and running jobs need room to end well.
  int64_t reserved_disk_bytes = 256 << 20;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_LIMITS_H_
