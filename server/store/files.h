// The few file operations that the data folder needs, above all those that make finished work durable.
#ifndef DEPTHTWEEN_SERVER_STORE_FILES_H_
#define DEPTHTWEEN_SERVER_STORE_FILES_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace depthtween::server {

// ResourceExhausted if the file has more than `max_bytes`.
absl::StatusOr<std::string> ReadWholeFile(const std::string& path, int64_t max_bytes);
// Not durable; for the scratch folder of a task.
absl::Status WriteScratchFile(const std::string& path, std::string_view bytes);
// The names of what lies in a folder; none if there is no such folder.
std::vector<std::string> NamesIn(const std::string& folder);
// Creates the folder and those above it that are missing.
absl::Status MakeFolder(const std::string& path);
// Makes the bytes of a file durable, but not its name.
absl::Status SyncFile(const std::string& path);
// Makes the names in a folder durable, as needed after a rename into it.
absl::Status SyncFolder(const std::string& path);
// Makes everything durable that was written to the disk that the folder is on: one wait for thousands of small files.
absl::Status SyncDisk(const std::string& folder);
// Moves a regular file, replacing what is there. NotFound if there is none, or if it is something else, such as a link.
absl::Status MoveFile(const std::string& from, const std::string& to);
// Gives a file that never changes a second name; one that is there already stays. NotFound if there is no such file.
absl::Status LinkFile(const std::string& from, const std::string& to);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_FILES_H_
