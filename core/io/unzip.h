// Unpacks a zip archive that a stranger made into a folder.
//
// Source: PKWARE's APPNOTE 6.3 with zip64; stored or deflated. What an archive says of itself is bounded before
// anything is written, and what comes out is bounded by what it said: a bomb ends at the first limit. Threads: safe to
// call concurrently, for different folders.
#ifndef DEPTHTWEEN_CORE_IO_UNZIP_H_
#define DEPTHTWEEN_CORE_IO_UNZIP_H_

#include <cstdint>
#include <functional>
#include <limits>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/io/violation_list.h"

namespace depthtween {

struct UnzipLimits {
  int max_files = std::numeric_limits<int>::max();
  int64_t max_bytes = std::numeric_limits<int64_t>::max();  // of all files together, unpacked
};

struct UnzipSummary {
  int files = -1;
  int64_t bytes = -1;
  // What is wrong with entries, by their names in the archive, or with the archive, by its own. Not empty: the folder
  // holds nothing of use.
  std::vector<FileViolation> violations;

  bool ok() const { return violations.empty(); }
};

// Writes every file of the archive below `folder`, which must be there. A folder that all files lie in is left out, as
// are folders without files and what systems add unasked (__MACOSX, ._NAME, .DS_Store, Thumbs.db, desktop.ini).
//
// Violations: names that leave the folder, are twice there, or differ in case alone; links and devices; encryption;
// other compression; damage; more than the limits. Of many, the first 100 are told. Errors: those of reading the
// archive and of writing, as in file.h; Cancelled when `stop` fires. `on_progress` is called with the files written and
// their number, at least once for each and every few megabytes; it may be empty.
absl::StatusOr<UnzipSummary> Unzip(const std::string& archive, const std::string& folder, const UnzipLimits& limits,
                                   const std::stop_token& stop,
                                   const std::function<void(int done, int of)>& on_progress);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_UNZIP_H_
