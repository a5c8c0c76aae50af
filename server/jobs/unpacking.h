// A recording that came as one zip archive: what is done in its folder around the child that unpacks it.
//
// Grammar:  CleanSequence (the child, ListUnpacked, MoveUnpacked, Store::FinishUnpacking, CleanSequence)?
// Wherever that is cut off, CleanSequence restores the state that the store knows, and all can be done again.
#ifndef DEPTHTWEEN_SERVER_JOBS_UNPACKING_H_
#define DEPTHTWEEN_SERVER_JOBS_UNPACKING_H_

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "server/store/checksums.h"
#include "server/store/records.h"

namespace depthtween::server {

// Leaves in the sequence's folder the archive alone, before it is unpacked; afterwards all but the archive.
absl::Status CleanSequence(const std::string& folder, const SequenceArchive& archive);

// What a child has unpacked.
struct UnpackedFiles {
  std::vector<FileChecksum> files;        // by path
  std::vector<FileViolation> violations;  // names that are no names of a sequence's files
};
// Looks for itself: the child is not trusted. Internal for what is neither file nor folder; ResourceExhausted for more
// than it was allowed; Cancelled when `stop` fires.
absl::StatusOr<UnpackedFiles> ListUnpacked(const std::string& folder, const SequenceArchive& archive, int max_files,
                                           int64_t max_bytes, const std::stop_token& stop);

// Moves all that is in a folder to another one on the same disk. Durable when it returns OK.
absl::Status MoveUnpacked(const std::string& from, const std::string& to);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_UNPACKING_H_
