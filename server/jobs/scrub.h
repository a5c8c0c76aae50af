// Reads stored files again and compares them with their checksums, so that rot is found while a backup still has the
// bytes.
#ifndef DEPTHTWEEN_SERVER_JOBS_SCRUB_H_
#define DEPTHTWEEN_SERVER_JOBS_SCRUB_H_

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "server/store/store.h"

namespace depthtween::server {

struct FileFault {
  std::string path;  // relative to the data folder
  std::string what;
};

struct ScrubSummary {
  int64_t files = 0;  // read
  int64_t bytes = 0;
  int64_t unknown_files = 0;  // stored before there were checksums: not read
  std::vector<FileFault> faults;
};

struct ScrubOptions {
  int64_t bytes_per_second = 0;                       // at most; 0: as fast as it goes
  std::function<void(const ScrubSummary&)> on_files;  // now and then; may be empty
};

// Checks up to `count` files after `cursor` (empty: the first ones) and adds what it finds to `summary`. Returns the
// cursor for the next call; empty when there is no more. What is deleted meanwhile is no fault. Bytes come from the
// disk, not from the system's memory of it. Cancelled when `stop` fires; otherwise errors are those of the store.
// Threads: may be called concurrently. Borrows `store`.
absl::StatusOr<std::string> ScrubSome(Store& store, const std::string& data_dir, const std::string& cursor, int count,
                                      int64_t bytes_per_second, const std::stop_token& stop, ScrubSummary& summary);

// All files, once. For an operator: opens the database of the folder to look at it, also while a server works there,
// and changes nothing.
absl::StatusOr<ScrubSummary> ScrubFolder(const std::string& data_dir, const ScrubOptions& options = {});

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_SCRUB_H_
