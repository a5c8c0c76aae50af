#include "core/io/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>

#include "absl/strings/str_format.h"
#include "core/base/descriptor.h"

namespace depthtween {
namespace {

std::string FolderOf(const std::string& path) {
  const size_t slash = path.find_last_of('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

// Hidden, beside the final file (a rename must not cross file systems), and unlike any other's. NAME_MAX is 255 bytes.
std::string TemporaryPath(const std::string& path) {
  static std::atomic<uint64_t> counter{0};
  const size_t slash = path.find_last_of('/');
  const size_t name_begin = slash == std::string::npos ? 0 : slash + 1;
  return absl::StrFormat("%s.%s.%d-%d.tmp", path.substr(0, name_begin), path.substr(name_begin, 200), ::getpid(),
                         counter.fetch_add(1));
}

bool WriteAll(int fd, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return true;
}

absl::Status SyncFolder(const std::string& folder) {
  const Descriptor fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!fd.valid() || ::fsync(fd.get()) != 0) return ErrnoStatus(errno, absl::StrCat("syncing folder ", folder));
  return absl::OkStatus();
}

// Fills the temporary file; leaves errno of the step that failed.
bool FillNewFile(const std::string& path, std::string_view bytes, bool durable) {
  Descriptor fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  return fd.valid() && WriteAll(fd.get(), bytes) && (!durable || ::fsync(fd.get()) == 0) && fd.Close();
}

absl::Status Write(const std::string& path, std::string_view bytes, bool durable) {
  const std::string temporary = TemporaryPath(path);
  if (!FillNewFile(temporary, bytes, durable) || ::rename(temporary.c_str(), path.c_str()) != 0) {
    const int error = errno;
    ::unlink(temporary.c_str());
    return ErrnoStatus(error, absl::StrCat("writing ", path));
  }
  return durable ? SyncFolder(FolderOf(path)) : absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes) {
  // O_NONBLOCK: opening a pipe without a writer would otherwise wait for one.
  const Descriptor fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat info = {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0) return ErrnoStatus(errno, absl::StrCat("reading ", path));
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat("reading ", path, ": not a regular file"));
  if (info.st_size > max_bytes)
    return absl::ResourceExhaustedError(
        absl::StrFormat("reading %s: has %d bytes, at most %d are allowed", path, info.st_size, max_bytes));
  std::string bytes(static_cast<size_t>(info.st_size), '\0');
  size_t filled = 0;
  while (filled < bytes.size()) {
    const ssize_t count = ::read(fd.get(), bytes.data() + filled, bytes.size() - filled);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return ErrnoStatus(errno, absl::StrCat("reading ", path));
    if (count == 0) break;  // cut short since fstat; the decoder will say so
    filled += static_cast<size_t>(count);
  }
  bytes.resize(filled);
  return bytes;
}

absl::Status WriteFile(const std::string& path, std::string_view bytes) {
  return Write(path, bytes, /*durable=*/false);
}

absl::Status WriteFileDurably(const std::string& path, std::string_view bytes) {
  return Write(path, bytes, /*durable=*/true);
}

absl::Status MakeFolder(const std::string& path) {
  struct stat info = {};
  if (::stat(path.c_str(), &info) == 0) {
    if (S_ISDIR(info.st_mode)) return absl::OkStatus();
    return absl::AlreadyExistsError(absl::StrCat("making folder ", path, ": a file of that name is there"));
  }
  if (errno != ENOENT) return ErrnoStatus(errno, absl::StrCat("making folder ", path));
  const size_t last = path.find_last_not_of('/');
  if (last == std::string::npos) return absl::InvalidArgumentError("making folder: the path is empty");
  const std::string folder = path.substr(0, last + 1), parent = FolderOf(folder);
  RETURN_IF_ERROR(MakeFolder(parent));
  // Another process may have been quicker.
  if (::mkdir(folder.c_str(), 0777) != 0 && errno != EEXIST)
    return ErrnoStatus(errno, absl::StrCat("making folder ", folder));
  return SyncFolder(parent);
}

bool FileExists(const std::string& path) {
  struct stat info = {};
  return ::stat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode);
}

std::string JoinPath(std::string_view folder, std::string_view name) {
  std::string path(folder);
  if (!path.empty() && path.back() != '/') path += '/';
  return path.append(name);
}

}  // namespace depthtween
