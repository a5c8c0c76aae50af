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

// A file that is written piece by piece.  Open Append* Finish  - it bears its name once Finish succeeds; destroyed
// before that it leaves nothing behind.
class GrowingFile {
 public:
  static absl::StatusOr<GrowingFile> Open(const std::string& path);
  ~GrowingFile();
  GrowingFile(GrowingFile&& other) noexcept;
  GrowingFile& operator=(GrowingFile&&) = delete;

  absl::Status Append(std::string_view bytes);
  absl::Status Finish();

 private:
  GrowingFile(std::string path, int descriptor) : path_(std::move(path)), descriptor_(descriptor) {}
  std::string Unfinished() const { return path_ + ".part"; }

  std::string path_;
  int descriptor_;  // -1 once finished, or moved from
};

absl::StatusOr<std::string> ReadFile(const std::string& path);

// Makes a folder and its parents; one that is there is fine.
absl::Status MakeFolder(const std::string& path);

// Whether `name` can only be a file inside the folder it is put in. Names from a server must pass this.
bool IsPlainFileName(std::string_view name);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_FILES_H_
