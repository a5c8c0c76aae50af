// Whole files: read at once, written whole or not at all.
//
// Errors:   as ErrnoStatus in core/base/status.h, naming the file: NotFound, PermissionDenied, ResourceExhausted for a
//           full disk. After an error no temporary file remains and an older file of that name is untouched.
// Threads:  safe to call concurrently, for the same path too: the last rename wins.
#ifndef DEPTHTWEEN_CORE_IO_FILE_H_
#define DEPTHTWEEN_CORE_IO_FILE_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween {

inline constexpr int64_t kDefaultMaxFileBytes = int64_t{1} << 30;  // no frame, list or report comes near

// ResourceExhausted when the file is larger than max_bytes. InvalidArgument when it is not a regular file (a pipe in a
// sequence folder must not hang its reader).
absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes = kDefaultMaxFileBytes);

// Readers see the old file or the new one. After a power cut it may be lost.
absl::Status WriteFile(const std::string& path, std::string_view bytes);

// As WriteFile, and when it returns OK the file survives a power cut: temporary file, fsync, rename, fsync of the
// folder.
absl::Status WriteFileDurably(const std::string& path, std::string_view bytes);

// Makes the folder and its parents. OK when it is there already.
absl::Status MakeFolder(const std::string& path);

// Whether there is a regular file, following symbolic links.
bool FileExists(const std::string& path);

// folder/name, with one slash.
std::string JoinPath(std::string_view folder, std::string_view name);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_FILE_H_
