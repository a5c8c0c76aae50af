// The bytes of sequences: files that arrive by uploads and never change after commit.
//
// Errors: ResourceExhausted (DISK_FULL) when there is no room; what was durable before stays so. InvalidArgument for a
// path against path_rules.h, before anything is touched. Threads: calls about different files may be concurrent.
#ifndef DEPTHTWEEN_SERVER_STORE_BLOB_STORE_H_
#define DEPTHTWEEN_SERVER_STORE_BLOB_STORE_H_

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

class BlobStore {
 public:
  virtual ~BlobStore() = default;

  // Writes `bytes` at `offset` and cuts the file off after them, which drops what an earlier, uncommitted attempt left
  // there. Offset 0 creates the file and its folders. After an error the content from `offset` on is undefined.
  virtual absl::Status Write(std::string_view sequence_id, std::string_view path, int64_t offset,
                             std::string_view bytes) = 0;
  // Returns when everything written so far, in all files, is durable. After an error nothing that was written since the
  // last success is, nor ever will be: systems forget what they could not write. It must be written again.
  virtual absl::Status MakeDurable() = 0;
  // How many times MakeDurable has failed, for any caller. Who finds that the number has changed between a write and a
  // MakeDurable of its own must write again.
  virtual int64_t FailedSyncs() const = 0;
  // Calls `sink` with the first `size` bytes of a file, piece by piece. DataLoss if it is shorter.
  virtual absl::Status Read(std::string_view sequence_id, std::string_view path, int64_t size,
                            const std::function<void(std::string_view)>& sink) = 0;
  // The file is gone, and the folders above it that are empty then. Nothing to do if there is none.
  virtual absl::Status RemoveFile(std::string_view sequence_id, std::string_view path) = 0;
  // The bytes of all files of the sequence are gone when this returns; the space follows soon.
  virtual absl::Status Remove(std::string_view sequence_id) = 0;
  virtual absl::StatusOr<int64_t> FreeBytes() = 0;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_BLOB_STORE_H_
