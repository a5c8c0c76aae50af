// Checks what a child is about to read, as far as that costs little beside its work: damaged bytes must not become
// results that look right.
//
//   validate, and a job's first task   every file of the recording, once
//   intervals, render                  the constants; to render also the depth and motion around the interval
//   assemble                           the constants, the reports of intervals, and depth if scene flow is made of it
//   one frame on demand                that frame's depth and motion
//
// Files that are missing are left to the child, which says what it misses.
#ifndef DEPTHTWEEN_SERVER_JOBS_INPUT_CHECK_H_
#define DEPTHTWEEN_SERVER_JOBS_INPUT_CHECK_H_

#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "server/jobs/damage_log.h"
#include "server/store/data_directory.h"
#include "server/store/records.h"
#include "server/store/store.h"

namespace depthtween::server {

// Errors: DataLoss (FILE_DAMAGED), which is also reported; Cancelled when `stop` fires; those of the store.
// Threads: may be called concurrently. Borrows all three.
class InputCheck {
 public:
  InputCheck(const DataDirectory& directory, Store& store, DamageLog& damage)
      : directory_(directory), store_(store), damage_(damage) {}

  // `job` is for all but validate tasks.
  absl::Status OfTask(const Task& task, const JobRecord& job, const std::stop_token& stop);
  absl::Status OfFrame(const JobRecord& job, const FrameRecord& frame);

 private:
  absl::Status Sequence(const std::string& id, const std::stop_token& stop);
  absl::Status JobFiles(const std::string& id, const std::vector<std::string>& paths, const std::stop_token& stop);
  absl::Status One(const std::string& resource, const FileChecksum& file, const std::stop_token& stop);

  const DataDirectory& directory_;
  Store& store_;
  DamageLog& damage_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_INPUT_CHECK_H_
