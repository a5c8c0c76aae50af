// Deleting what has both a record and files.
#ifndef DEPTHTWEEN_SERVER_JOBS_DELETION_H_
#define DEPTHTWEEN_SERVER_JOBS_DELETION_H_

#include <functional>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

// Deletes the record of `name` by `forget`, then its files by `remove`. A crash in between leaves files without a
// record, which the next start moves to quarantine. If the disk is too full to delete the record, deletes the files
// first, then retries the record for a few seconds. Errors: those of both; the message says what is left.
absl::Status DeleteWithFiles(std::string_view name, const std::function<absl::Status()>& forget,
                             const std::function<absl::Status()>& remove);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_DELETION_H_
