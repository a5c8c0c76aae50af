#include "server/store/data_directory.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <stop_token>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace depthtween::server {
namespace {

namespace fs = std::filesystem;

std::string ReadShortFile(int fd) {
  std::array<char, 64> text{};
  const ssize_t size = pread(fd, text.data(), text.size(), 0);
  return size <= 0 ? std::string() : std::string(absl::StripAsciiWhitespace({text.data(), static_cast<size_t>(size)}));
}

}  // namespace

absl::StatusOr<std::unique_ptr<DataDirectory>> DataDirectory::Open(const std::string& path) {
  std::error_code error;
  std::string absolute = fs::absolute(path, error).lexically_normal();
  while (absolute.size() > 1 && absolute.back() == '/') absolute.pop_back();
  for (const char* folder : {"", "/sequences", "/jobs", "/tasks", "/trash"}) {
    fs::create_directories(absolute + folder, error);
    if (error) return ErrnoStatus(error.value(), "create the data folder " + absolute + folder);
  }
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
  const std::string pid = absl::StrCat(getpid(), "\n");
  if (ftruncate(fd, 0) != 0 || pwrite(fd, pid.data(), pid.size(), 0) != static_cast<ssize_t>(pid.size())) {
    const absl::Status status = ErrnoStatus(errno, "write " + lock);
    close(fd);
    return status;
  }
  return std::unique_ptr<DataDirectory>(new DataDirectory(absolute, fd));
}

DataDirectory::DataDirectory(std::string path, int lock_fd)
    : path_(std::move(path)), lock_fd_(lock_fd), sweeper_([this](std::stop_token stop) { EmptyTrash(stop); }) {}

DataDirectory::~DataDirectory() {
  sweeper_.request_stop();
  sweeper_.join();
  close(lock_fd_);
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

void DataDirectory::EmptyTrash(std::stop_token stop) {
  while (true) {
    {
      std::unique_lock lock(mutex_);
      if (!trash_changed_.wait(lock, stop, [this] { return trash_full_; })) return;
      trash_full_ = false;
    }
    std::error_code error;
    for (fs::directory_iterator entry(path_ + "/trash", error), end; !error && entry != end; entry.increment(error)) {
      if (stop.stop_requested()) return;
      // A child that is just ending may still write into its folder: what cannot be removed now goes with the next
      // sweep.
      std::error_code ignored;
      fs::remove_all(entry->path(), ignored);
    }
  }
}

}  // namespace depthtween::server
