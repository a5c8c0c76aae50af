#include "core/io/folder_parts.h"

#include <sys/stat.h>

#include <cerrno>
#include <cstdlib>
#include <memory>

#include "absl/strings/str_format.h"
#include "core/io/file.h"

namespace depthtween {
namespace {

constexpr int64_t kMaxCameraBytes = 1 << 20;
constexpr int64_t kMaxListBytes = int64_t{kMaxListedFrames} * 1100;  // the longest names there may be

// The status of a file that the folder itself must have, without its path: violations carry the name.
absl::StatusOr<std::string> ReadPart(const std::string& dir, const std::string& name, int64_t max_bytes) {
  if (!FileExists(JoinPath(dir, name))) return absl::NotFoundError("missing, a sequence folder must have it");
  return ReadFile(JoinPath(dir, name), max_bytes);
}

// The path without symbolic links, or empty with errno set.
std::string RealPath(const std::string& path) {
  const std::unique_ptr<char, decltype(&std::free)> real(::realpath(path.c_str(), nullptr), &std::free);
  return real ? std::string(real.get()) : std::string();
}

absl::Status CheckListedFile(const std::string& real_dir, const std::string& name, const std::string& list_name) {
  const std::string real = RealPath(JoinPath(real_dir, name));
  if (real.empty()) {
    if (errno == ENOENT || errno == ENOTDIR)
      return absl::NotFoundError(absl::StrCat("listed in ", list_name, " but missing"));
    return ErrnoStatus(errno, "finding the file");
  }
  if (!real.starts_with(JoinPath(real_dir, "")))
    return absl::InvalidArgumentError("is a symbolic link that leaves the sequence folder: copy the file into it");
  if (!FileExists(real)) return absl::InvalidArgumentError("must be a regular file");
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckFolder(const std::string& dir) {
  struct stat info = {};
  if (::stat(dir.c_str(), &info) != 0) return ErrnoStatus(errno, absl::StrCat("opening folder ", dir));
  if (!S_ISDIR(info.st_mode)) return absl::NotFoundError(absl::StrCat("opening folder ", dir, ": not a folder"));
  return absl::OkStatus();
}

CameraFile ReadCameraPart(const std::string& dir, ViolationList& violations) {
  const absl::StatusOr<std::string> text = ReadPart(dir, "camera.json", kMaxCameraBytes);
  const absl::StatusOr<CameraFile> file = text.ok() ? ParseCameraJson(*text) : text.status();
  if (file.ok()) return *file;
  violations.Add("camera.json", file.status());
  return {};
}

FrameList ReadListPart(const std::string& dir, const std::string& list_name, ViolationList& violations) {
  const absl::StatusOr<std::string> text = ReadPart(dir, list_name, kMaxListBytes);
  if (!text.ok()) {
    violations.Add(list_name, text.status());
    return {};
  }
  FrameList list = ParseFrameList(*text);
  for (const absl::Status& problem : list.problems) violations.Add(list_name, problem);
  const std::string real_dir = RealPath(dir);
  for (const FrameRef& frame : list.frames) {
    if (absl::Status status = CheckListedFile(real_dir, frame.path, list_name); !status.ok())
      violations.Add(frame.path, status);
  }
  return list;
}

}  // namespace depthtween
