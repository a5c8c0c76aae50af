#include "server/store/data_directory.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/store/files.h"
#include "server/store/resource_names.h"

namespace depthtween::server {
namespace {

namespace fs = std::filesystem;

std::string ReadShortFile(int fd) {
  std::array<char, 64> text{};
  const ssize_t size = pread(fd, text.data(), text.size(), 0);
  return size <= 0 ? std::string() : std::string(absl::StripAsciiWhitespace({text.data(), static_cast<size_t>(size)}));
}

constexpr char kMarkerTitle[] = "depthtween data folder";
constexpr char kQuarantineTime[] = "%E4Y%m%dT%H%M%SZ";
constexpr absl::Duration kQuarantineGap = absl::Hours(1);

// FailedPrecondition, naming what is there, unless the folder holds no more than an interrupted first start leaves.
absl::Status CheckEmpty(const std::string& folder) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename();
    if (name == "lock" || name == "lost+found" || name == std::string(kFolderMarker) + ".new") continue;
    return absl::FailedPreconditionError(absl::StrCat(folder, " is not a data folder of a server: it holds ", name,
                                                      " and no file ", kFolderMarker,
                                                      ". Name a folder that is empty or missing with --data-dir"));
  }
  return error ? ErrnoStatus(error.value(), "list " + folder) : absl::OkStatus();
}

// The folder's id.
absl::StatusOr<std::string> ReadOrMakeMarker(const std::string& folder) {
  absl::StatusOr<std::string> id = ReadFolderId(folder);
  if (!absl::IsNotFound(id.status())) return id;
  const std::string marker = absl::StrCat(folder, "/", kFolderMarker), draft = marker + ".new";
  RETURN_IF_ERROR(WriteScratchFile(draft, absl::StrCat(kMarkerTitle, "\n", NewId(), NewId(), "\n")));
  RETURN_IF_ERROR(SyncFile(draft));
  RETURN_IF_ERROR(MoveFile(draft, marker));
  RETURN_IF_ERROR(SyncFolder(folder));
  return ReadFolderId(folder);
}

}  // namespace

absl::StatusOr<std::string> ReadFolderId(const std::string& folder) {
  const std::string marker = absl::StrCat(folder, "/", kFolderMarker);
  ASSIGN_OR_RETURN(const std::string text, ReadWholeFile(marker, /*max_bytes=*/256));
  const std::vector<std::string> lines = absl::StrSplit(text, '\n');
  if (lines.size() != 3 || lines[0] != kMarkerTitle || lines[1].empty()) {
    return absl::DataLossError(absl::StrCat(marker, " is damaged: it must hold \"", kMarkerTitle,
                                            "\" and, on a second line, the id of the folder"));
  }
  return lines[1];
}

absl::StatusOr<std::unique_ptr<DataDirectory>> DataDirectory::Open(const std::string& path,
                                                                   const DataDirectoryOptions& options) {
  std::error_code error;
  std::string absolute = fs::absolute(path, error).lexically_normal();
  while (absolute.size() > 1 && absolute.back() == '/') absolute.pop_back();
  fs::create_directories(absolute, error);
  if (error) return ErrnoStatus(error.value(), "create the data folder " + absolute);
  // Before anything is written: the folder may be somebody else's.
  if (!fs::exists(absl::StrCat(absolute, "/", kFolderMarker), error)) RETURN_IF_ERROR(CheckEmpty(absolute));
  const std::string lock = absolute + "/lock";
  const int fd = open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd < 0) return ErrnoStatus(errno, "open " + lock);
  // A child that a killed server had just forked shares its lock until it notices, which takes it milliseconds.
  int locked = flock(fd, LOCK_EX | LOCK_NB);
  for (int i = 0; i < 50 && locked != 0 && errno == EWOULDBLOCK; ++i) {
    absl::SleepFor(absl::Milliseconds(20));
    locked = flock(fd, LOCK_EX | LOCK_NB);
  }
  if (locked != 0) {
    const int error_number = errno;
    const std::string owner = ReadShortFile(fd);
    close(fd);
    if (error_number != EWOULDBLOCK) return ErrnoStatus(error_number, "lock " + lock);
    return absl::FailedPreconditionError(
        absl::StrCat("the data folder ", absolute, " is in use by the server with process id ",
                     owner.empty() ? "(unknown)" : owner, "; stop it, or choose another --data-dir"));
  }
  // For whoever finds the folder in use; a full disk, which may have no space for it, is no reason not to start.
  const std::string pid = absl::StrFormat("%-10d\n", getpid());
  [[maybe_unused]] const ssize_t written = pwrite(fd, pid.data(), pid.size(), 0);
  absl::StatusOr<std::string> id = ReadOrMakeMarker(absolute);
  for (const char* folder : {"/sequences", "/jobs", "/tasks", "/trash", "/quarantine"}) {
    if (!id.ok()) break;
    fs::create_directories(absolute + folder, error);
    if (error) id = ErrnoStatus(error.value(), "create the data folder " + absolute + folder);
  }
  if (!id.ok()) {
    close(fd);
    return id.status();
  }
  return std::unique_ptr<DataDirectory>(new DataDirectory(absolute, *std::move(id), fd, options));
}

DataDirectory::DataDirectory(std::string path, std::string id, int lock_fd, const DataDirectoryOptions& options)
    : path_(std::move(path)),
      id_(std::move(id)),
      options_(options),
      lock_fd_(lock_fd),
      sweeper_([this](const std::stop_token& stop) { Sweep(stop); }) {}

DataDirectory::~DataDirectory() {
  sweeper_.request_stop();
  sweeper_.join();
  close(lock_fd_);
}

absl::StatusOr<int64_t> DataDirectory::FreeBytes() const {
  struct statvfs space {};
  if (statvfs(path_.c_str(), &space) != 0) return ErrnoStatus(errno, "statvfs " + path_);
  return static_cast<int64_t>(space.f_bavail) * static_cast<int64_t>(space.f_frsize);
}

absl::Status DataDirectory::WithoutPath(const absl::Status& status) const {
  if (status.ok()) return status;
  const std::string_view said(status.message().data(), status.message().size());
  std::string words;
  size_t from = 0;
  for (size_t at = 0; (at = said.find(path_, from)) != std::string_view::npos;) {
    const size_t after = at + path_.size();
    const char next = after < said.size() ? said[after] : '\0';
    words += said.substr(from, at - from);
    from = after;
    if (next == '/') {
      ++from;
    } else if (next == '_' || next == '-' || absl::ascii_isalnum(next)) {
      words += path_;  // another folder, whose name begins alike
    } else {
      words += "the data folder";
    }
  }
  words += said.substr(from);
  absl::Status told(status.code(), words);
  status.ForEachPayload([&told](absl::string_view type, const absl::Cord& payload) { told.SetPayload(type, payload); });
  return told;
}

std::string DataDirectory::Join(std::string_view kind, std::string_view id) const {
  std::string joined = path_;
  joined.append(kind).append(id);
  return joined;
}

absl::Status DataDirectory::Discard(const std::string& folder) {
  // The time keeps names apart from those that an earlier process left.
  const std::string target =
      Join("/trash/", absl::StrCat(absl::ToUnixNanos(absl::Now()), "-", trash_count_.fetch_add(1)));
  if (rename(folder.c_str(), target.c_str()) != 0) {
    return errno == ENOENT ? absl::OkStatus() : ErrnoStatus(errno, "discard " + folder);
  }
  {
    const std::lock_guard lock(mutex_);
    trash_full_ = true;
  }
  trash_changed_.notify_one();
  return absl::OkStatus();
}

absl::StatusOr<std::string> DataDirectory::Quarantine(const std::string& folder, std::string_view name) {
  const std::string stem =
      Join("/quarantine/",
           absl::StrCat(absl::FormatTime(kQuarantineTime, absl::Now(), absl::UTCTimeZone()), "-", std::string(name)));
  std::string target = stem;
  // A second of the same name within a second; rename would replace it if it were empty.
  for (int i = 2; access(target.c_str(), F_OK) == 0; ++i) target = absl::StrCat(stem, "-", i);
  if (rename(folder.c_str(), target.c_str()) != 0) {
    return ErrnoStatus(errno, absl::StrCat("move ", folder, " to ", target));
  }
  return target;
}

void DataDirectory::Sweep(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    ExpireQuarantine(stop);
    bool trash = false;
    {
      std::unique_lock lock(mutex_);
      trash_changed_.wait_for(lock, stop, absl::ToChronoSeconds(kQuarantineGap), [this] { return trash_full_; });
      trash = std::exchange(trash_full_, false);
    }
    if (trash) EmptyTrash(stop);
  }
}

void DataDirectory::EmptyTrash(const std::stop_token& stop) {
  std::error_code error;
  for (fs::directory_iterator entry(path_ + "/trash", error), end; !error && entry != end; entry.increment(error)) {
    if (stop.stop_requested()) return;
    // A child that is just ending may still write into its folder: what cannot be removed now goes with the next sweep.
    std::error_code ignored;
    fs::remove_all(entry->path(), ignored);
  }
}

void DataDirectory::ExpireQuarantine(const std::stop_token& stop) {
  const absl::Time oldest = absl::Now() - options_.keep_quarantine;
  std::error_code error;
  for (fs::directory_iterator entry(QuarantineFolder(), error), end; !error && entry != end; entry.increment(error)) {
    if (stop.stop_requested()) return;
    const std::string name = entry->path().filename();
    absl::Time arrived;
    std::string why;
    // What has no such name was put there by hand, and stays.
    if (!absl::ParseTime(kQuarantineTime, name.substr(0, name.find('-')), &arrived, &why) || arrived >= oldest)
      continue;
    std::error_code ignored;
    fs::remove_all(entry->path(), ignored);
  }
}

}  // namespace depthtween::server
