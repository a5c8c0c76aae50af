// Deleting what has both a record and files.
#ifndef DEPTHTWEEN_SERVER_JOBS_DELETION_H_
#define DEPTHTWEEN_SERVER_JOBS_DELETION_H_

#include <functional>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

// Deletes the record of `name` by `forget`, then its files by `remove`: a crash in between leaves files that nobody
// names, which the next start removes. A full disk has no room to write even that down: then the files go first, and
// the record is tried again for a few seconds. Errors: of both, and what is left then.
absl::Status DeleteWithFiles(std::string_view name, const std::function<absl::Status()>& forget,
                             const std::function<absl::Status()>& remove);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_DELETION_H_
