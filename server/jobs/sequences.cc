#include "server/jobs/sequences.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/depthtween/crc32c.h"
#include "server/jobs/deletion.h"
#include "server/store/error_info.h"
#include "server/telemetry/metrics.h"

namespace depthtween::server {

// Shared by all writers of one upload. A later writer takes the turn away from an earlier one.
struct UploadWriter::Turn {
  std::mutex mutex;    // held while bytes are written or made durable
  int64_t number = 0;  // guarded by mutex: of the writer whose turn it is
};

UploadWriter::UploadWriter(Sequences& sequences, UploadRecord upload, std::vector<UploadFile> files,
                           std::shared_ptr<Turn> turn, int64_t turn_number)
    : sequences_(sequences),
      upload_(std::move(upload)),
      files_(std::move(files)),
      turn_(std::move(turn)),
      turn_number_(turn_number),
      written_(upload_.committed_size) {
  // The file at the upload's position. One that ends just there is complete.
  while (file_ < files_.size() && written_ >= file_start_ + files_[file_].size_bytes &&
         (files_[file_].size_bytes > 0 || written_ > file_start_)) {
    file_start_ += files_[file_].size_bytes;
    ++file_;
  }
}

UploadWriter::~UploadWriter() { Close().IgnoreError(); }

absl::Status UploadWriter::CheckTurn() const {
  if (turn_->number == turn_number_) return absl::OkStatus();
  return WithErrorInfo(absl::AbortedError("another call has taken over this upload, or deleted it"),
                       {.reason = "TAKEN_OVER", .metadata = {{"upload", upload_.id}}});
}

absl::Status UploadWriter::Write(int64_t offset, std::string_view bytes, uint32_t crc32c) {
  const std::lock_guard lock(turn_->mutex);
  RETURN_IF_ERROR(CheckTurn());
  const auto committed = std::pair("committed_size", absl::StrCat(written_));
  if (offset != written_) {
    return WithErrorInfo(absl::OutOfRangeError(absl::StrFormat(
                             "write_offset = %d, but the upload is at %d; continue from there", offset, written_)),
                         {.reason = "OFFSET_MISMATCH", .metadata = {committed}});
  }
  if (const int64_t most = sequences_.store_.limits().Get().max_chunk_bytes;
      static_cast<int64_t>(bytes.size()) > most) {
    return LimitExceeded("max_chunk_bytes", most,
                         absl::StrFormat("the message carries %d bytes, at most %d are allowed; send smaller pieces",
                                         bytes.size(), most));
  }
  if (static_cast<int64_t>(bytes.size()) > upload_.size_bytes - written_) {
    return WithErrorInfo(
        absl::OutOfRangeError(absl::StrFormat("%d bytes at %d go beyond the %d bytes that were announced", bytes.size(),
                                              written_, upload_.size_bytes)),
        {.reason = "OFFSET_MISMATCH", .metadata = {committed}});
  }
  if (const uint32_t actual = Crc32c(bytes); actual != crc32c) {
    return WithErrorInfo(absl::DataLossError(absl::StrFormat(
                             "crc32c of the %d bytes at %d is %08x, the message says %08x; send them again",
                             bytes.size(), offset, actual, crc32c)),
                         {.reason = "CHECKSUM_MISMATCH", .metadata = {committed}});
  }
  if (const absl::Status status = WriteToFiles(bytes); !status.ok()) {
    // Keeps what arrived whole, so that the client need not resend it. If that fails too, committed_size says so.
    Flush().IgnoreError();
    return status;
  }
  return written_ - upload_.committed_size >= kFlushBytes ? Flush() : absl::OkStatus();
}

absl::Status UploadWriter::WriteToFiles(std::string_view bytes) {
  while (true) {
    // Creates empty files on the way.
    while (file_ < files_.size() && written_ == file_start_ + files_[file_].size_bytes) RETURN_IF_ERROR(CompleteFile());
    if (bytes.empty()) return absl::OkStatus();
    const UploadFile& file = files_[file_];
    RETURN_IF_ERROR(ResumeSums());
    const int64_t left = file_start_ + file.size_bytes - written_;
    const std::string_view piece = bytes.substr(0, static_cast<size_t>(left));
    RETURN_IF_ERROR(WriteToFile(file.path, written_ - file_start_, piece));
    sums_->blocks.Update(piece);
    if (sums_->sha256) sums_->sha256->Update(piece);
    written_ += static_cast<int64_t>(piece.size());
    bytes.remove_prefix(piece.size());
  }
}

absl::Status UploadWriter::WriteToFile(std::string_view path, int64_t offset, std::string_view bytes) {
  if (!std::exchange(touched_, true)) failed_syncs_ = sequences_.blobs_.FailedSyncs();
  return sequences_.blobs_.Write(upload_.sequence_id, path, offset, bytes);
}

absl::Status UploadWriter::ResumeSums() {
  if (sums_) return absl::OkStatus();
  const UploadFile& file = files_[file_];
  Sums sums;
  if (!file.sha256.empty()) sums.sha256.emplace();
  if (const int64_t present = written_ - file_start_; present > 0) {
    RETURN_IF_ERROR(sequences_.blobs_.Read(upload_.sequence_id, file.path, present, [&sums](std::string_view bytes) {
      sums.blocks.Update(bytes);
      if (sums.sha256) sums.sha256->Update(bytes);
    }));
  }
  sums_ = std::move(sums);
  return absl::OkStatus();
}

absl::Status UploadWriter::CompleteFile() {
  const UploadFile& file = files_[file_];
  if (file.size_bytes == 0) {
    RETURN_IF_ERROR(WriteToFile(file.path, 0, {}));
  }
  RETURN_IF_ERROR(ResumeSums());
  Sums sums = *std::exchange(sums_, std::nullopt);
  if (sums.sha256 && sums.sha256->Finish() != file.sha256) {
    written_ = file_start_;
    return WithErrorInfo(
        absl::DataLossError(
            absl::StrCat(file.path, ": its bytes do not match the announced sha256; send the file again")),
        {.reason = "CHECKSUM_MISMATCH", .metadata = {{"path", file.path}, {"committed_size", absl::StrCat(written_)}}});
  }
  complete_.push_back(sums.blocks.Finish(file.path));
  file_start_ += file.size_bytes;
  ++file_;
  return absl::OkStatus();
}

absl::Status UploadWriter::Flush() {
  RETURN_IF_ERROR(lost_);
  if (touched_) {
    lost_ = sequences_.blobs_.MakeDurable();
    // The sync of another upload has failed and may have lost bytes of this one.
    if (lost_.ok() && sequences_.blobs_.FailedSyncs() != failed_syncs_) {
      lost_ = absl::UnavailableError("bytes were lost on the way to the disk; continue from committed_size");
    }
    RETURN_IF_ERROR(lost_);
  }
  touched_ = false;
  if (written_ == upload_.committed_size && complete_.empty()) return absl::OkStatus();
  RETURN_IF_ERROR(sequences_.store_.SetCommittedSize(upload_.id, written_, complete_));
  CountBytes("in", written_ - upload_.committed_size);
  upload_.committed_size = written_;
  complete_.clear();
  return absl::OkStatus();
}

absl::StatusOr<UploadRecord> UploadWriter::Close() {
  const std::lock_guard lock(turn_->mutex);
  RETURN_IF_ERROR(CheckTurn());
  RETURN_IF_ERROR(Flush());
  ASSIGN_OR_RETURN(upload_, sequences_.store_.GetUpload(Tenant::Everyone(), upload_.sequence_id, upload_.id));
  return upload_;
}

absl::StatusOr<UploadRecord> UploadWriter::Finish() {
  const std::lock_guard lock(turn_->mutex);
  RETURN_IF_ERROR(CheckTurn());
  if (const absl::Status status = WriteToFiles({}); !status.ok()) {
    Flush().IgnoreError();
    return status;
  }
  RETURN_IF_ERROR(Flush());
  ASSIGN_OR_RETURN(upload_, sequences_.store_.FinishUpload(upload_.id));
  return upload_;
}

Sequences::Sequences(Store& store, BlobStore& blobs, std::function<void()> on_work,
                     std::function<void(std::string_view id)> on_delete)
    : store_(store), blobs_(blobs), on_work_(std::move(on_work)), on_delete_(std::move(on_delete)) {}

absl::StatusOr<SequenceRecord> Sequences::Create(const Tenant& tenant, std::string_view display_name,
                                                 std::string_view request_id) {
  return store_.CreateSequence(tenant, display_name, request_id);
}

absl::StatusOr<SequenceRecord> Sequences::Get(const Tenant& tenant, std::string_view id) {
  return store_.GetSequence(tenant, id);
}

absl::StatusOr<Page<SequenceRecord>> Sequences::List(const Tenant& tenant, const SequenceFilter& filter,
                                                     const PageRequest& page) {
  return store_.ListSequences(tenant, filter, page);
}

absl::Status Sequences::Delete(const Tenant& tenant, std::string_view id) {
  const auto forget = [&]() -> absl::Status {
    RETURN_IF_ERROR(store_.DeleteSequence(tenant, id));
    if (on_delete_) on_delete_(id);
    return absl::OkStatus();
  };
  return DeleteWithFiles(absl::StrCat("sequences/", std::string(id)), forget, [&] { return blobs_.Remove(id); });
}

absl::StatusOr<UploadRecord> Sequences::StartUpload(const Tenant& tenant, std::string_view sequence_id,
                                                    const std::vector<UploadFile>& files, std::string_view request_id,
                                                    std::string_view metadata) {
  ASSIGN_OR_RETURN(const int64_t free_bytes, blobs_.FreeBytes());
  const int64_t room_bytes = std::max<int64_t>(0, free_bytes - store_.limits().Get().reserved_disk_bytes);
  return store_.CreateUpload(tenant, sequence_id, files, room_bytes, request_id, metadata);
}

absl::StatusOr<UploadRecord> Sequences::GetUpload(const Tenant& tenant, std::string_view sequence_id,
                                                  std::string_view upload_id) {
  return store_.GetUpload(tenant, sequence_id, upload_id);
}

absl::StatusOr<std::shared_ptr<UploadWriter::Turn>> Sequences::TurnOf(const Tenant& tenant,
                                                                      std::string_view sequence_id,
                                                                      std::string_view upload_id) {
  // Checked before the turn exists, so that unknown ids leave nothing behind.
  RETURN_IF_ERROR(store_.GetUpload(tenant, sequence_id, upload_id).status());
  const std::lock_guard lock(mutex_);
  std::erase_if(turns_, [](const auto& entry) { return entry.second.expired(); });
  std::weak_ptr<UploadWriter::Turn>& known = turns_[std::string(upload_id)];
  std::shared_ptr<UploadWriter::Turn> turn = known.lock();
  if (!turn) known = turn = std::make_shared<UploadWriter::Turn>();
  return turn;
}

absl::Status Sequences::DeleteUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id) {
  ASSIGN_OR_RETURN(const std::shared_ptr<UploadWriter::Turn> turn, TurnOf(tenant, sequence_id, upload_id));
  const std::lock_guard lock(turn->mutex);
  ASSIGN_OR_RETURN(const std::vector<UploadFile> files, store_.UploadFiles(upload_id));
  const auto rewind = [&]() -> absl::Status {
    RETURN_IF_ERROR(store_.RewindUpload(tenant, sequence_id, upload_id));
    ++turn->number;
    return absl::OkStatus();
  };
  const auto remove = [&]() -> absl::Status {
    for (const UploadFile& file : files) RETURN_IF_ERROR(blobs_.RemoveFile(sequence_id, file.path));
    return absl::OkStatus();
  };
  RETURN_IF_ERROR(DeleteWithFiles(absl::StrCat("uploads/", std::string(upload_id)), rewind, remove));
  return store_.DeleteUpload(tenant, sequence_id, upload_id);
}

absl::StatusOr<std::unique_ptr<UploadWriter>> Sequences::OpenUpload(const Tenant& tenant, std::string_view sequence_id,
                                                                    std::string_view upload_id) {
  ASSIGN_OR_RETURN(std::shared_ptr<UploadWriter::Turn> turn, TurnOf(tenant, sequence_id, upload_id));
  // While the turn's mutex is held, the earlier writer is between two writes, and its last ones may not be durable yet:
  // they are written again, from the size that the store knows.
  const std::lock_guard lock(turn->mutex);
  ASSIGN_OR_RETURN(UploadRecord upload, store_.GetUpload(tenant, sequence_id, upload_id));
  if (upload.finished) return WrongState("FINISHED", "the upload is finished and takes no more bytes");
  ASSIGN_OR_RETURN(std::vector<UploadFile> files, store_.UploadFiles(upload_id));
  const int64_t number = ++turn->number;
  return std::unique_ptr<UploadWriter>(
      new UploadWriter(*this, std::move(upload), std::move(files), std::move(turn), number));
}

absl::Status Sequences::RemoveAbandoned(const Collectable& sequence) {
  return DeleteWithFiles(
      "sequences/" + sequence.id, [&] { return store_.DeleteAbandonedSequence(sequence); },
      [&] { return blobs_.Remove(sequence.id); });
}

absl::Status Sequences::Collect(const Collectable& sequence) {
  return DeleteWithFiles(
      "sequences/" + sequence.id, [&] { return store_.CollectSequence(sequence); },
      [&] { return blobs_.Remove(sequence.id); });
}

absl::StatusOr<SequenceRecord> Sequences::Commit(const Tenant& tenant, std::string_view id) {
  ASSIGN_OR_RETURN(SequenceRecord record, store_.CommitSequence(tenant, id));
  on_work_();
  return record;
}

}  // namespace depthtween::server
