#include "server/store/checksums.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "proto/depthtween/crc32c.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr size_t kCrcBytes = 4;

void AppendCrc(uint32_t crc32c, std::string& blocks) {
  for (size_t i = 0; i < kCrcBytes; ++i) blocks.push_back(static_cast<char>((crc32c >> (8 * i)) & 0xFFU));
}

// NotFound for what is no file, such as a link or a pipe: a child may have put it there.
absl::StatusOr<int> OpenRegular(const std::string& file, struct stat& info) {
  const int fd = open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0 && errno != ELOOP) return ErrnoStatus(errno, "open " + file);
  if (fd >= 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode)) return fd;
  if (fd >= 0) close(fd);
  return absl::NotFoundError(file + " is not a regular file");
}

// Calls `on_block` with each block of a file until it returns false.
absl::Status ReadBlocks(int fd, const std::string& file, const std::function<bool(std::string_view)>& on_block) {
  std::vector<char> block(static_cast<size_t>(kChecksumBlockBytes));
  while (true) {
    size_t filled = 0;
    while (filled < block.size()) {
      const ssize_t got = read(fd, block.data() + filled, block.size() - filled);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return ErrnoStatus(errno, "read " + file);
      if (got == 0) break;
      filled += static_cast<size_t>(got);
    }
    if (filled == 0 || !on_block({block.data(), filled}) || filled < block.size()) return absl::OkStatus();
  }
}

}  // namespace

void BlockChecksums::Update(std::string_view bytes) {
  while (!bytes.empty()) {
    const int64_t left = kChecksumBlockBytes - size_bytes_ % kChecksumBlockBytes;
    const std::string_view piece = bytes.substr(0, static_cast<size_t>(left));
    crc32c_ = ExtendCrc32c(crc32c_, piece);
    size_bytes_ += static_cast<int64_t>(piece.size());
    bytes.remove_prefix(piece.size());
    if (size_bytes_ % kChecksumBlockBytes == 0) AppendCrc(std::exchange(crc32c_, 0), blocks_);
  }
}

FileChecksum BlockChecksums::Finish(std::string path) {
  if (size_bytes_ % kChecksumBlockBytes != 0) AppendCrc(crc32c_, blocks_);
  return {.path = std::move(path), .size_bytes = size_bytes_, .blocks = std::move(blocks_)};
}

absl::StatusOr<FileChecksum> ChecksumOf(const std::string& file, std::string path) {
  struct stat info {};
  ASSIGN_OR_RETURN(const int fd, OpenRegular(file, info));
  const absl::Cleanup close_it = [fd] { close(fd); };
  BlockChecksums checksums;
  RETURN_IF_ERROR(ReadBlocks(fd, file, [&checksums](std::string_view block) {
    checksums.Update(block);
    return true;
  }));
  return checksums.Finish(std::move(path));
}

bool Matches(const FileChecksum& checksum, std::string_view bytes) {
  BlockChecksums is;
  is.Update(bytes);
  return is.size_bytes() == checksum.size_bytes && is.Finish("").blocks == checksum.blocks;
}

bool BlockMatches(const FileChecksum& checksum, int64_t block, std::string_view bytes) {
  const int64_t start = block * kChecksumBlockBytes;
  if (static_cast<int64_t>(bytes.size()) != std::min(kChecksumBlockBytes, checksum.size_bytes - start)) return false;
  std::string is;
  AppendCrc(Crc32c(bytes), is);
  return std::string_view(checksum.blocks).substr(static_cast<size_t>(block) * kCrcBytes, kCrcBytes) == is;
}

absl::Status CheckFile(const std::string& file, const FileChecksum& checksum,
                       const std::function<bool(int64_t bytes)>& go_on, bool cold) {
  struct stat info {};
  ASSIGN_OR_RETURN(const int fd, OpenRegular(file, info));
  const absl::Cleanup close_it = [fd, cold] {
    if (cold) posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    close(fd);
  };
  if (info.st_size != checksum.size_bytes) {
    return absl::DataLossError(absl::StrCat("it has ", info.st_size, " bytes, ", checksum.size_bytes, " were stored"));
  }
  if (cold) posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
  int64_t block = 0;
  bool intact = true, stopped = false;
  const absl::Status read = ReadBlocks(fd, file, [&](std::string_view bytes) {
    intact = BlockMatches(checksum, block, bytes);
    if (intact) ++block;
    stopped = intact && go_on && !go_on(static_cast<int64_t>(bytes.size()));
    return intact && !stopped;
  });
  if (!read.ok()) return absl::DataLossError(read.message());
  if (stopped) return absl::CancelledError("the check was stopped");
  if (intact) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("its bytes are not those that were stored, first between ",
                                          block * kChecksumBlockBytes, " and ",
                                          std::min(checksum.size_bytes, (block + 1) * kChecksumBlockBytes)));
}

}  // namespace depthtween::server
