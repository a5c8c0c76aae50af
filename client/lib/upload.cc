#include "client/lib/upload.h"

#include <algorithm>
#include <chrono>
#include <span>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client/lib/backoff.h"
#include "proto/depthtween/crc32c.h"
#include "proto/depthtween/sha256.h"

namespace depthtween::client {
namespace {

using Sequences = v1::SequenceService::StubInterface;

constexpr int64_t kChunkBytes = 1 << 20;
constexpr size_t kFilesPerUpload = 4096;  // announcing them takes 0.4 MB: well below the 4 MiB a message may have

// Sends one group of files, which travel as one upload.
class GroupUpload {
 public:
  GroupUpload(Connection& connection, const std::string& directory, std::span<const LocalFile> files,
              std::function<void(int64_t bytes_done)> on_progress)
      : connection_(connection), files_(files), bytes_(directory, files), on_progress_(std::move(on_progress)) {}

  // Announces the files, or finds them announced. Returns the bytes that are there already.
  absl::StatusOr<int64_t> Start(const std::string& sequence_name) {
    v1::StartUploadRequest request;
    request.set_parent(sequence_name);
    Sha256 id;
    for (const LocalFile& file : files_) {
      v1::Upload::File& announced = *request.mutable_upload()->add_files();
      announced.set_path(file.path);
      announced.set_size_bytes(file.size_bytes);
      announced.set_sha256(file.sha256);
      id.Update(absl::StrCat(file.path, "\n", file.size_bytes, "\n", Hex(file.sha256), "\n"));
    }
    request.mutable_upload()->set_size_bytes(bytes_.size_bytes());
    request.set_request_id(Hex(id.Finish()));
    ASSIGN_OR_RETURN(upload_, connection_.Call(connection_.sequences(), &Sequences::StartUpload, request));
    return upload_.committed_size();
  }

  absl::Status Send() {
    int damaged = 0;
    Backoff backoff = connection_.NewBackoff();
    while (upload_.state() != v1::Upload::STATE_FINISHED) {
      const int64_t before = upload_.committed_size();
      const absl::Status status = Write();
      if (status.ok()) continue;
      // Aborted: the server has yet to notice that the stream before this one is dead. OutOfRange: that stream got
      // further than we knew.
      const bool may_pass = IsTransient(status) || absl::IsAborted(status) || absl::IsOutOfRange(status);
      if (!may_pass && !(absl::IsDataLoss(status) && ++damaged < kDamagedTries)) return status;
      v1::GetUploadRequest where;
      where.set_name(upload_.name());
      ASSIGN_OR_RETURN(upload_, connection_.Call(connection_.sequences(), &Sequences::GetUpload, where));
      if (upload_.committed_size() > before) backoff.Reset();
      if (!backoff.Wait(status)) return status;
    }
    return absl::OkStatus();
  }

 private:
  // One stream from committed_size to the end, or as far as it gets.
  absl::Status Write() {
    grpc::ClientContext context;  // no deadline: a large recording on a slow line takes as long as it takes
    connection_.Authorize(context);
    v1::Upload answer;
    const auto stream = connection_.sequences().WriteUpload(&context, &answer);
    const int64_t chunk_limit = connection_.server().limits().max_chunk_bytes();
    const int64_t chunk_bytes = chunk_limit > 0 ? std::min(kChunkBytes, chunk_limit) : kChunkBytes;
    v1::WriteUploadRequest message;
    message.set_name(upload_.name());
    for (int64_t offset = upload_.committed_size(); !message.finish();) {
      absl::StatusOr<std::string> data = bytes_.Read(offset, chunk_bytes);
      if (!data.ok()) {
        context.TryCancel();
        stream->Finish().IgnoreError();
        return data.status();
      }
      message.set_write_offset(offset);
      offset += static_cast<int64_t>(data->size());
      message.set_crc32c(Crc32c(*data));
      message.set_data(*std::move(data));
      message.set_finish(offset == bytes_.size_bytes());
      if (!stream->Write(message)) break;  // the server has ended the stream; Finish says why
      message.clear_name();
      if (on_progress_) on_progress_(offset);
    }
    stream->WritesDone();
    RETURN_IF_ERROR(connection_.Answer(stream->Finish()));
    upload_ = answer;
    return absl::OkStatus();
  }

  Connection& connection_;
  const std::span<const LocalFile> files_;
  ConcatenatedFiles bytes_;
  const std::function<void(int64_t bytes_done)> on_progress_;
  v1::Upload upload_;
};

}  // namespace

absl::StatusOr<v1::Sequence> UploadSequence(Connection& connection, const LocalSequence& sequence,
                                            const std::function<void(const UploadProgress&)>& on_progress) {
  v1::CreateSequenceRequest create;
  create.mutable_sequence()->set_display_name(sequence.display_name);
  create.set_request_id(sequence.fingerprint);
  ASSIGN_OR_RETURN(v1::Sequence remote, connection.Call(connection.sequences(), &Sequences::CreateSequence, create));
  UploadProgress progress{.bytes_total = sequence.size_bytes};
  if (remote.state() != v1::Sequence::STATE_UPLOADING) {
    progress.bytes_done = progress.bytes_found = progress.bytes_total;
    if (on_progress) on_progress(progress);
    return remote;
  }

  const size_t limit = std::max(connection.server().limits().max_files_per_upload(), 0);
  const size_t group_size = limit > 0 ? std::min(limit, kFilesPerUpload) : kFilesPerUpload;
  const std::span<const LocalFile> files = sequence.files;
  for (size_t first = 0; first < files.size(); first += group_size) {
    const int64_t before = progress.bytes_done;
    const auto report = [&](int64_t bytes_done) {
      progress.bytes_done = before + bytes_done;
      if (on_progress) on_progress(progress);
    };
    GroupUpload group(connection, sequence.directory, files.subspan(first, std::min(group_size, files.size() - first)),
                      report);
    ASSIGN_OR_RETURN(const int64_t found, group.Start(remote.name()));
    progress.bytes_found += found;
    report(found);
    RETURN_IF_ERROR(group.Send());
  }

  v1::CommitSequenceRequest commit;
  commit.set_name(remote.name());
  return connection.Call(connection.sequences(), &Sequences::CommitSequence, commit);
}

absl::StatusOr<v1::Sequence> AwaitValidation(Connection& connection, const std::string& name,
                                             const std::function<void(const v1::Sequence&)>& on_progress) {
  constexpr std::chrono::milliseconds kFirstPause{50}, kLongestPause{500};
  v1::GetSequenceRequest request;
  request.set_name(name);
  for (std::chrono::milliseconds pause = kFirstPause;; pause = std::min(pause * 2, kLongestPause)) {
    ASSIGN_OR_RETURN(v1::Sequence sequence, connection.Call(connection.sequences(), &Sequences::GetSequence, request));
    if (on_progress) on_progress(sequence);
    if (sequence.state() != v1::Sequence::STATE_VALIDATING) return sequence;
    std::this_thread::sleep_for(pause);
  }
}

}  // namespace depthtween::client
