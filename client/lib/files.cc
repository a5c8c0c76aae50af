#include "client/lib/files.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

namespace depthtween::client {

absl::StatusOr<GrowingFile> GrowingFile::Open(const std::string& path) {
  GrowingFile file(path, -1);
  file.descriptor_ = open(file.Unfinished().c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file.descriptor_ < 0) return ErrnoStatus(errno, "writing " + path);
  return file;
}

GrowingFile::~GrowingFile() {
  if (descriptor_ < 0) return;
  close(descriptor_);
  unlink(Unfinished().c_str());
}

GrowingFile::GrowingFile(GrowingFile&& other) noexcept
    : path_(std::move(other.path_)), descriptor_(std::exchange(other.descriptor_, -1)) {}

absl::Status GrowingFile::Append(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return ErrnoStatus(errno, "writing " + path_);
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

absl::Status GrowingFile::Finish() {
  absl::Status status;
  if (close(std::exchange(descriptor_, -1)) != 0) status = ErrnoStatus(errno, "writing " + path_);
  if (status.ok() && std::rename(Unfinished().c_str(), path_.c_str()) != 0)
    status = ErrnoStatus(errno, "writing " + path_);
  if (!status.ok()) unlink(Unfinished().c_str());
  return status;
}

absl::Status WriteFile(const std::string& path, std::string_view bytes) {
  ASSIGN_OR_RETURN(GrowingFile file, GrowingFile::Open(path));
  RETURN_IF_ERROR(file.Append(bytes));
  return file.Finish();
}

absl::StatusOr<std::string> ReadFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return ErrnoStatus(errno, "reading " + path);
  std::ostringstream bytes;
  bytes << in.rdbuf();
  if (in.bad()) return ErrnoStatus(errno, "reading " + path);
  return std::move(bytes).str();
}

absl::Status MakeFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  return error ? ErrnoStatus(error.value(), "making the folder " + path) : absl::OkStatus();
}

bool IsPlainFileName(std::string_view name) {
  return !name.empty() && name != "." && name != ".." && name.size() <= 255 &&
         name.find('/') == std::string_view::npos && name.find('\0') == std::string_view::npos;
}

}  // namespace depthtween::client
