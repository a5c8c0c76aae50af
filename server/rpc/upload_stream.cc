#include "server/rpc/upload_stream.h"

#include <grpcpp/impl/codegen/proto_utils.h>

#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "depthtween/v1/sequence.pb.h"
#include "server/rpc/encode.h"
#include "server/rpc/status.h"
#include "server/rpc/undecodable.h"

namespace depthtween::server {
namespace {

// At any time either gRPC holds the stream (a read is under way) or the executor does (a message is being written), or
// it is ending. The holder decides who is next.
class UploadStream : public grpc::ServerReadReactor<grpc::ByteBuffer>,
                     public Stoppable,
                     public std::enable_shared_from_this<UploadStream> {
 public:
  UploadStream(CallRuntime& runtime, grpc::CallbackServerContext* context, Sequences& sequences,
               grpc::ByteBuffer* response)
      : sequences_(sequences), response_(response), call_(runtime, context, CallKind::kStream, "WriteUpload", "") {}

  void Start() {
    self_ = shared_from_this();
    call_.runtime().Register(self_);
    if (call_.admission().ok()) {
      Read();
    } else {
      EndSoon(call_.admission());
    }
  }

  void OnReadDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      if (holder_ == Holder::kEnd) return;
      holder_ = Holder::kExecutor;
    }
    // Not ok: the client has finished or is gone. What arrived is kept either way.
    call_.runtime().executor().Post([stream = shared_from_this(), ok] { ok ? stream->Take() : stream->End({}); });
  }

  void OnDone() override { const std::shared_ptr<UploadStream> self = std::move(self_); }

  void Stop() override {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
      if (holder_ != Holder::kGrpc) return;  // the holder sees stopping_
    }
    EndSoon(ServerStopping());
  }

 private:
  enum class Holder { kGrpc, kExecutor, kEnd };

  void Read() {
    {
      const std::lock_guard lock(mutex_);
      holder_ = Holder::kGrpc;
    }
    StartRead(&bytes_);
  }

  void EndSoon(const absl::Status& status) {
    {
      const std::lock_guard lock(mutex_);
      if (holder_ != Holder::kGrpc) return;
      holder_ = Holder::kEnd;
    }
    call_.runtime().executor().Post([stream = shared_from_this(), status] { stream->End(status); });
  }

  // On the executor: one message.
  void Take() {
    bool finished = false;
    absl::Status status = CatchExceptions([&] { return Write(&finished); });
    {
      const std::lock_guard lock(mutex_);
      if (status.ok() && !finished && stopping_) status = ServerStopping();
    }
    if (status.ok() && !finished) {
      Read();
    } else {
      End(status);
    }
  }

  absl::Status Write(bool* finished) {
    RETURN_IF_ERROR(DecodeMessage(bytes_, request_));
    if (writer_ == nullptr) {
      name_ = request_.name();
      call_.SetSubject(name_);
      ASSIGN_OR_RETURN(const UploadIds ids, ParseUploadName("name", name_));
      ASSIGN_OR_RETURN(writer_, sequences_.OpenUpload(call_.caller().tenant, ids.sequence_id, ids.upload_id));
    } else if (!request_.name().empty() && request_.name() != name_) {
      return InvalidField("name", "differs from that of the first message, must be the same or empty");
    }
    const std::string& data = request_.data();
    if (!data.empty()) {
      if (!request_.has_crc32c()) return InvalidField("crc32c", "is missing, must be the CRC-32C of data");
      RETURN_IF_ERROR(writer_->Write(request_.write_offset(), data, request_.crc32c()));
    }
    if (request_.finish()) {
      ASSIGN_OR_RETURN(const UploadRecord record, writer_->Finish());
      writer_.reset();
      Respond(record);
      *finished = true;
    }
    return absl::OkStatus();
  }

  void Respond(const UploadRecord& record) {
    bool own = false;
    grpc::GenericSerialize<grpc::ProtoBufferWriter, v1::Upload>(Encode(record), response_, &own);
  }

  // On the executor: keeps what arrived, and answers.
  void End(absl::Status status) {
    {
      const std::lock_guard lock(mutex_);
      holder_ = Holder::kEnd;
    }
    if (status.ok() && name_.empty()) status = InvalidField("name", "is missing: the stream had no message");
    if (writer_ != nullptr) {
      const absl::Status closed = CatchExceptions([&]() -> absl::Status {
        ASSIGN_OR_RETURN(const UploadRecord record, writer_->Close());
        Respond(record);
        return absl::OkStatus();
      });
      if (status.ok()) status = closed;
      writer_.reset();
    }
    Finish(call_.Answer(status));
  }

  Sequences& sequences_;
  grpc::ByteBuffer* const response_;
  Call call_;
  grpc::ByteBuffer bytes_;                // of the holder
  v1::WriteUploadRequest request_;        // of the holder
  std::string name_;                      // of the holder
  std::unique_ptr<UploadWriter> writer_;  // of the holder
  std::mutex mutex_;
  Holder holder_ = Holder::kGrpc;       // guarded by mutex_
  bool stopping_ = false;               // guarded by mutex_
  std::shared_ptr<UploadStream> self_;  // from Start to OnDone
};

}  // namespace

grpc::ServerReadReactor<grpc::ByteBuffer>* ReceiveUpload(CallRuntime& runtime, grpc::CallbackServerContext* context,
                                                         Sequences& sequences, grpc::ByteBuffer* response) {
  const auto stream = std::make_shared<UploadStream>(runtime, context, sequences, response);
  stream->Start();
  return stream.get();
}

}  // namespace depthtween::server
