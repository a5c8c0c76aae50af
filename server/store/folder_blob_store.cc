#include "server/store/folder_blob_store.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "server/store/error_info.h"
#include "server/store/path_rules.h"

namespace depthtween::server {
namespace {

// The failure of a call that writes; a full disk carries its reason.
absl::Status WriteError(int error_number, const std::string& what) {
  const absl::Status status = ErrnoStatus(error_number, what);
  return absl::IsResourceExhausted(status) ? DiskFull(std::string(status.message())) : status;
}

class FolderBlobStore : public BlobStore {
 public:
  explicit FolderBlobStore(DataDirectory& directory) : directory_(directory) {}

  absl::Status Write(std::string_view sequence_id, std::string_view path, int64_t offset,
                     std::string_view bytes) override {
    RETURN_IF_ERROR(CheckRelativePath(path));
    const std::string file = File(sequence_id, path);
    if (offset == 0) RETURN_IF_ERROR(MakeFolders(file));
    const int fd = open(file.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW | (offset == 0 ? O_CREAT : 0), 0644);
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
    // One syncfs for hundreds of small files and their folders, where fsync would be one wait each.
    const int fd = open(directory_.SequencesFolder().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return ErrnoStatus(errno, "open " + directory_.SequencesFolder());
    const absl::Cleanup close_folder = [fd] { close(fd); };
    if (syncfs(fd) != 0) return WriteError(errno, "sync " + directory_.SequencesFolder());
    return absl::OkStatus();
  }

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
      if (mkdir(folder.c_str(), 0755) != 0 && errno != EEXIST) return WriteError(errno, "create " + folder);
    }
    return absl::OkStatus();
  }

  DataDirectory& directory_;
};

}  // namespace

std::unique_ptr<BlobStore> MakeFolderBlobStore(DataDirectory& directory) {
  return std::make_unique<FolderBlobStore>(directory);
}

}  // namespace depthtween::server
