// What tells whether a file still holds the bytes that were stored: a CRC-32C for each block of it.
//
// CRC-32C, because rot is meant and not forgery: it finds every single flipped bit and costs an instruction for 8
// bytes, so that a frame can be checked each time it is read. Blocks, because a piece of a video must not cost reading
// all of it, and because what was found right an hour ago may be wrong now.
#ifndef DEPTHTWEEN_SERVER_STORE_CHECKSUMS_H_
#define DEPTHTWEEN_SERVER_STORE_CHECKSUMS_H_

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

inline constexpr int64_t kChecksumBlockBytes = 256 << 10;

struct FileChecksum {
  std::string path;  // relative to the folder of the sequence or the job it is of: "rgb/0.png", "out/report.json"
  int64_t size_bytes = 0;
  std::string blocks;  // 4 bytes for each block, little-endian; the last block may be shorter
};

// Of bytes that arrive in pieces. Grammar:  Update* Finish
class BlockChecksums {
 public:
  void Update(std::string_view bytes);
  int64_t size_bytes() const { return size_bytes_; }
  // The checksum of all bytes so far, as that of the file `path`.
  FileChecksum Finish(std::string path);

 private:
  std::string blocks_;   // of those that are complete
  uint32_t crc32c_ = 0;  // of the one that is not
  int64_t size_bytes_ = 0;
};

// Of the file at `file`, under the name `path`. NotFound if there is none, or if it is something else, such as a link
// or a pipe; other errors: those of reading it.
absl::StatusOr<FileChecksum> ChecksumOf(const std::string& file, std::string path);

// Whether these are the bytes of the whole file.
bool Matches(const FileChecksum& checksum, std::string_view bytes);
// Whether these are the bytes of block number `block`, 0 first.
bool BlockMatches(const FileChecksum& checksum, int64_t block, std::string_view bytes);

// Reads the file at `file` and compares: NotFound if there is none, DataLoss if it has other bytes or cannot be read,
// Cancelled if `go_on` returns false. `go_on` is called after each piece with its size; it may be empty. With `cold`
// the bytes are read from the disk and not from the system's memory of it, and leave no trace there.
absl::Status CheckFile(const std::string& file, const FileChecksum& checksum,
                       const std::function<bool(int64_t bytes)>& go_on = nullptr, bool cold = false);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_CHECKSUMS_H_
