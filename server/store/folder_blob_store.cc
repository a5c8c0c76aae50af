#include "server/store/folder_blob_store.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <mutex>
#include <string>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "server/store/error_info.h"
#include "server/store/files.h"
#include "server/store/path_rules.h"

namespace depthtween::server {
namespace {

constexpr int kFolderTries = 100;

// The failure of a call that writes; a full disk carries its reason.
absl::Status WithReason(const absl::Status& status) {
  return absl::IsResourceExhausted(status) ? DiskFull(std::string(status.message())) : status;
}
absl::Status WriteError(int error_number, const std::string& what) {
  return WithReason(ErrnoStatus(error_number, what));
}

class FolderBlobStore : public BlobStore {
 public:
  explicit FolderBlobStore(DataDirectory& directory) : directory_(directory) {}

  absl::Status Write(std::string_view sequence_id, std::string_view path, int64_t offset,
                     std::string_view bytes) override {
    RETURN_IF_ERROR(CheckRelativePath(path));
    const std::string file = File(sequence_id, path);
    int fd = -1;
    // RemoveFile of another upload may take a folder away before there is a file in it.
    for (int tries = 0; fd < 0 && tries < kFolderTries; ++tries) {
      if (offset == 0) RETURN_IF_ERROR(MakeFolders(file));
      fd = open(file.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW | (offset == 0 ? O_CREAT : 0), 0644);
      if (fd < 0 && (errno != ENOENT || offset != 0)) break;
    }
    if (fd < 0) return WriteError(errno, "open " + file);
    const absl::Cleanup close_file = [fd] { close(fd); };
    if (ftruncate(fd, offset) != 0) return WriteError(errno, "truncate " + file);
    while (!bytes.empty()) {
      const ssize_t written = pwrite(fd, bytes.data(), bytes.size(), offset);
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) return WriteError(errno, "write " + file);
      bytes.remove_prefix(static_cast<size_t>(written));
      offset += written;
    }
    return absl::OkStatus();
  }

  absl::Status MakeDurable() override {
    // One at a time: the system tells of a failed write once, and the next caller must know of it.
    const std::lock_guard lock(sync_mutex_);
    const absl::Status synced = WithReason(SyncDisk(directory_.SequencesFolder()));
    if (!synced.ok()) ++failed_syncs_;
    return synced;
  }

  int64_t FailedSyncs() const override { return failed_syncs_; }

  absl::Status Read(std::string_view sequence_id, std::string_view path, int64_t size,
                    const std::function<void(std::string_view)>& sink) override {
    RETURN_IF_ERROR(CheckRelativePath(path));
    const std::string file = File(sequence_id, path);
    const int fd = open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0) return ErrnoStatus(errno, "open " + file);
    const absl::Cleanup close_file = [fd] { close(fd); };
    constexpr int64_t kPieceBytes = 1 << 20;
    std::vector<char> piece(static_cast<size_t>(std::min(size, kPieceBytes)));
    while (size > 0) {
      const ssize_t got = read(fd, piece.data(), static_cast<size_t>(std::min<int64_t>(size, kPieceBytes)));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return ErrnoStatus(errno, "read " + file);
      if (got == 0)
        return absl::DataLossError(absl::StrCat(file, " is ", size, " bytes shorter than what was committed"));
      sink({piece.data(), static_cast<size_t>(got)});
      size -= got;
    }
    return absl::OkStatus();
  }

  absl::Status RemoveFile(std::string_view sequence_id, std::string_view path) override {
    RETURN_IF_ERROR(CheckRelativePath(path));
    std::string file = File(sequence_id, path);
    if (unlink(file.c_str()) != 0 && errno != ENOENT && errno != ENOTDIR) return ErrnoStatus(errno, "remove " + file);
    // What is not empty stays.
    for (size_t parts = std::count(path.begin(), path.end(), '/'); parts > 0; --parts) {
      file.resize(file.rfind('/'));
      if (rmdir(file.c_str()) != 0) break;
    }
    return absl::OkStatus();
  }

  absl::Status Remove(std::string_view sequence_id) override {
    return directory_.Discard(directory_.SequenceFolder(sequence_id));
  }

  absl::StatusOr<int64_t> FreeBytes() override { return directory_.FreeBytes(); }

 private:
  std::string File(std::string_view sequence_id, std::string_view path) const {
    return directory_.SequenceFolder(sequence_id).append("/").append(path);
  }

  // The folders above `file`, from the sequence's own downwards.
  absl::Status MakeFolders(const std::string& file) {
    for (size_t slash = file.find('/', directory_.SequencesFolder().size() + 1); slash != std::string::npos;
         slash = file.find('/', slash + 1)) {
      const std::string folder = file.substr(0, slash);
      if (mkdir(folder.c_str(), 0755) == 0 || errno == EEXIST) continue;
      if (errno != ENOENT) return WriteError(errno, "create " + folder);
      break;  // the folder above it has just been removed: Write sees that, and tries again
    }
    return absl::OkStatus();
  }

  DataDirectory& directory_;
  std::mutex sync_mutex_;
  std::atomic<int64_t> failed_syncs_ = 0;  // written with sync_mutex_ held
};

}  // namespace

std::unique_ptr<BlobStore> MakeFolderBlobStore(DataDirectory& directory) {
  return std::make_unique<FolderBlobStore>(directory);
}

}  // namespace depthtween::server
