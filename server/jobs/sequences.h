// Sequences from their creation to their commit: the rules of uploading, between the RPC layer and the stores.
#ifndef DEPTHTWEEN_SERVER_JOBS_SEQUENCES_H_
#define DEPTHTWEEN_SERVER_JOBS_SEQUENCES_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "proto/depthtween/sha256.h"
#include "server/store/blob_store.h"
#include "server/store/checksums.h"
#include "server/store/limits.h"
#include "server/store/store.h"

namespace depthtween::server {

class Sequences;

// One stream of bytes into one upload.
//
// Grammar:  Write* (Finish | Close)?     - destroying it without either is like Close.
// Errors: OutOfRange (OFFSET_MISMATCH) when `offset` is not where the upload stands; DataLoss (CHECKSUM_MISMATCH) when
// a crc32c or a file's sha256 does not match: nothing of that message, or of that file, is kept; ResourceExhausted when
// the disk is full; Aborted (TAKEN_OVER) once another writer of the same upload was opened: the newer connection wins,
// because the older one is usually dead without knowing; Unavailable when bytes were lost on the way to the disk
// because of another upload. After an error only Close makes sense, and a new writer may go on. Threads: one at a time.
class UploadWriter {
 public:
  ~UploadWriter();
  UploadWriter(const UploadWriter&) = delete;
  UploadWriter& operator=(const UploadWriter&) = delete;

  // Bytes are durable when Close or Finish returned OK, and every kFlushBytes on the way.
  absl::Status Write(int64_t offset, std::string_view bytes, uint32_t crc32c);
  // Makes durable what was written. The record says how far the upload is.
  absl::StatusOr<UploadRecord> Close();
  // Close, and the upload is complete. FailedPrecondition if bytes are missing.
  absl::StatusOr<UploadRecord> Finish();

 private:
  friend class Sequences;
  struct Turn;  // whose turn it is to write an upload
  static constexpr int64_t kFlushBytes = 16 << 20;

  UploadWriter(Sequences& sequences, UploadRecord upload, std::vector<UploadFile> files, std::shared_ptr<Turn> turn,
               int64_t turn_number);
  // All of these with the turn's mutex held.
  absl::Status CheckTurn() const;
  absl::Status WriteToFiles(std::string_view bytes);
  absl::Status WriteToFile(std::string_view path, int64_t offset, std::string_view bytes);
  // Takes up the checksums of the current file where it stands.
  absl::Status ResumeSums();
  absl::Status CompleteFile();
  absl::Status Flush();

  Sequences& sequences_;
  UploadRecord upload_;  // committed_size as the store knows it
  const std::vector<UploadFile> files_;
  const std::shared_ptr<Turn> turn_;
  const int64_t turn_number_;
  size_t file_ = 0;           // the file being written
  int64_t file_start_ = 0;    // its offset in the upload
  int64_t written_ = 0;       // offset in the upload; bytes beyond committed_size are not yet durable
  bool touched_ = false;      // something was written that is not durable yet
  int64_t failed_syncs_ = 0;  // of the blobs, before the first of it was written
  absl::Status lost_;         // why it never will be: what was written must be written again, by another writer
  // Of the current file up to written_; none if it is not begun.
  struct Sums {
    BlockChecksums blocks;
    std::optional<Sha256> sha256;  // if the client announced one
  };
  std::optional<Sums> sums_;
  std::vector<FileChecksum> complete_;  // files that became complete since the last flush
};

// Threads: all methods may be called concurrently. Borrows the stores.
class Sequences {
 public:
  // `on_work` is called after a commit: there is a validation to do. `on_delete` is called when a sequence is gone from
  // the store, before its files are: its validation is to end. It may be empty.
  Sequences(Store& store, BlobStore& blobs, std::function<void()> on_work,
            std::function<void(std::string_view id)> on_delete = nullptr);

  // As in Store.
  absl::StatusOr<SequenceRecord> Create(const Tenant& tenant, std::string_view display_name,
                                        std::string_view request_id);
  absl::StatusOr<SequenceRecord> Get(const Tenant& tenant, std::string_view id);
  absl::StatusOr<Page<SequenceRecord>> List(const Tenant& tenant, const SequenceFilter& filter,
                                            const PageRequest& page);
  // The record, and the files with it.
  absl::Status Delete(const Tenant& tenant, std::string_view id);

  // As Store::CreateUpload; also ResourceExhausted (DISK_FULL) when the disk has no room for it.
  absl::StatusOr<UploadRecord> StartUpload(const Tenant& tenant, std::string_view sequence_id,
                                           const std::vector<UploadFile>& files, std::string_view request_id,
                                           std::string_view metadata = {});
  absl::StatusOr<UploadRecord> GetUpload(const Tenant& tenant, std::string_view sequence_id,
                                         std::string_view upload_id);
  // With its bytes; a writer of it gets Aborted (TAKEN_OVER). FailedPrecondition if it is finished.
  absl::Status DeleteUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id);
  // Takes over from any earlier writer of this upload. FailedPrecondition if it is finished.
  absl::StatusOr<std::unique_ptr<UploadWriter>> OpenUpload(const Tenant& tenant, std::string_view sequence_id,
                                                           std::string_view upload_id);
  // As Store::DeleteAbandonedSequence and Store::CollectSequence, and the files with it.
  absl::Status RemoveAbandoned(const Collectable& sequence);
  absl::Status Collect(const Collectable& sequence);
  // As Store::PinSequence.
  absl::StatusOr<SequenceRecord> Pin(const Tenant& tenant, std::string_view id, bool pinned) {
    return store_.PinSequence(tenant, id, pinned);
  }
  LiveLimits& limits() { return store_.limits(); }
  absl::StatusOr<SequenceRecord> Commit(const Tenant& tenant, std::string_view id);

 private:
  friend class UploadWriter;

  // NotFound for an upload that does not exist.
  absl::StatusOr<std::shared_ptr<UploadWriter::Turn>> TurnOf(const Tenant& tenant, std::string_view sequence_id,
                                                             std::string_view upload_id);

  Store& store_;
  BlobStore& blobs_;
  const std::function<void()> on_work_;
  const std::function<void(std::string_view id)> on_delete_;
  std::mutex mutex_;
  std::map<std::string, std::weak_ptr<UploadWriter::Turn>, std::less<>> turns_;  // guarded by mutex_; by upload id
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_SEQUENCES_H_
