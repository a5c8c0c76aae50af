// Files that the client writes.
#ifndef DEPTHTWEEN_CLIENT_LIB_FILES_H_
#define DEPTHTWEEN_CLIENT_LIB_FILES_H_

#include <string>
#include <string_view>

#include "client/lib/status.h"

namespace depthtween::client {

// Puts `bytes` under `path` as a whole or not at all: a reader never sees half a file. Not forced to disk: what a crash
// of this machine loses can be fetched again.
absl::Status WriteFile(const std::string& path, std::string_view bytes);

absl::StatusOr<std::string> ReadFile(const std::string& path);

// Makes a folder and its parents; one that is there is fine.
absl::Status MakeFolder(const std::string& path);

// Whether `name` can only be a file inside the folder it is put in. Names from a server are held to this.
bool IsPlainFileName(std::string_view name);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_FILES_H_
