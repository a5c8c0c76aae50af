#include "server/rpc/sequence_service.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "depthtween/v1/sequence.grpc.pb.h"
#include "server/rpc/encode.h"
#include "server/rpc/status.h"
#include "server/rpc/upload_stream.h"

namespace depthtween::server {
namespace {

using grpc::CallbackServerContext;
using grpc::ServerUnaryReactor;

absl::StatusOr<std::vector<UploadFile>> DecodeFiles(const v1::Upload& upload) {
  std::vector<UploadFile> files;
  files.reserve(upload.files_size());
  __int128 size_bytes = 0;  // a hostile manifest must not overflow its own check
  for (const v1::Upload::File& file : upload.files()) {
    files.push_back({.path = file.path(), .size_bytes = file.size_bytes(), .sha256 = file.sha256()});
    size_bytes += file.size_bytes();
  }
  if (upload.size_bytes() != 0 && upload.size_bytes() != size_bytes) {
    return InvalidField("upload.size_bytes",
                        absl::StrFormat("= %d, must be the sum over upload.files, or 0", upload.size_bytes()));
  }
  return files;
}

// WriteUpload comes as bytes, see upload_stream.h.
using SequenceServiceBase =
    v1::SequenceService::WithRawCallbackMethod_WriteUpload<v1::SequenceService::CallbackService>;

class SequenceService : public SequenceServiceBase {
 public:
  SequenceService(CallRuntime& runtime, Sequences& sequences, JobManager& jobs, const LiveLimits& limits)
      : runtime_(runtime), sequences_(sequences), jobs_(jobs), limits_(limits) {}

  ServerUnaryReactor* CreateSequence(CallbackServerContext* context, const v1::CreateSequenceRequest* request,
                                     v1::Sequence* response) override {
    return runtime_.Unary(context, "CreateSequence", "", [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const SequenceRecord record,
                       sequences_.Create(caller.tenant, request->sequence().display_name(), request->request_id()));
      *response = EncodeWithProgress(record);
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* GetSequence(CallbackServerContext* context, const v1::GetSequenceRequest* request,
                                  v1::Sequence* response) override {
    return runtime_.Unary(context, "GetSequence", request->name(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string id, ParseSequenceName("name", request->name()));
      ASSIGN_OR_RETURN(const SequenceRecord record, sequences_.Get(caller.tenant, id));
      *response = EncodeWithProgress(record);
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* ListSequences(CallbackServerContext* context, const v1::ListSequencesRequest* request,
                                    v1::ListSequencesResponse* response) override {
    return runtime_.Unary(context, "ListSequences", "", [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const SequenceFilter filter, ParseSequenceFilter(request->filter()));
      ASSIGN_OR_RETURN(const PageRequest page,
                       ParsePage(request->page_size(), request->page_token(), limits_.Get().max_page_size));
      return FillPage(page, response, [&](const PageRequest& some) -> absl::Status {
        ASSIGN_OR_RETURN(const Page<SequenceRecord> records, sequences_.List(caller.tenant, filter, some));
        for (const SequenceRecord& record : records.items) *response->add_sequences() = EncodeWithProgress(record);
        response->set_next_page_token(records.next_token);
        return absl::OkStatus();
      });
    });
  }

  ServerUnaryReactor* DeleteSequence(CallbackServerContext* context, const v1::DeleteSequenceRequest* request,
                                     google::protobuf::Empty* response) override {
    return runtime_.Unary(context, "DeleteSequence", request->name(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string id, ParseSequenceName("name", request->name()));
      return sequences_.Delete(caller.tenant, id);
    });
  }

  ServerUnaryReactor* StartUpload(CallbackServerContext* context, const v1::StartUploadRequest* request,
                                  v1::Upload* response) override {
    return runtime_.Unary(context, "StartUpload", request->parent(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string sequence_id, ParseSequenceName("parent", request->parent()));
      ASSIGN_OR_RETURN(const std::vector<UploadFile> files, DecodeFiles(request->upload()));
      ASSIGN_OR_RETURN(const UploadRecord record,
                       sequences_.StartUpload(caller.tenant, sequence_id, files, request->request_id(),
                                              request->upload().metadata()));
      *response = Encode(record);
      return absl::OkStatus();
    });
  }

  grpc::ServerReadReactor<grpc::ByteBuffer>* WriteUpload(CallbackServerContext* context,
                                                         grpc::ByteBuffer* response) override {
    return ReceiveUpload(runtime_, context, sequences_, response);
  }

  ServerUnaryReactor* GetUpload(CallbackServerContext* context, const v1::GetUploadRequest* request,
                                v1::Upload* response) override {
    return runtime_.Unary(context, "GetUpload", request->name(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const UploadIds ids, ParseUploadName("name", request->name()));
      ASSIGN_OR_RETURN(const UploadRecord record, sequences_.GetUpload(caller.tenant, ids.sequence_id, ids.upload_id));
      *response = Encode(record);
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* DeleteUpload(CallbackServerContext* context, const v1::DeleteUploadRequest* request,
                                   google::protobuf::Empty* response) override {
    return runtime_.Unary(context, "DeleteUpload", request->name(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const UploadIds ids, ParseUploadName("name", request->name()));
      return sequences_.DeleteUpload(caller.tenant, ids.sequence_id, ids.upload_id);
    });
  }

  ServerUnaryReactor* CommitSequence(CallbackServerContext* context, const v1::CommitSequenceRequest* request,
                                     v1::Sequence* response) override {
    return runtime_.Unary(context, "CommitSequence", request->name(), [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string id, ParseSequenceName("name", request->name()));
      ASSIGN_OR_RETURN(const SequenceRecord record, sequences_.Commit(caller.tenant, id));
      *response = EncodeWithProgress(record);
      return absl::OkStatus();
    });
  }

  ServerUnaryReactor* PinSequence(CallbackServerContext* context, const v1::PinSequenceRequest* request,
                                  v1::Sequence* response) override {
    return Pin(context, "PinSequence", request->name(), true, response);
  }

  ServerUnaryReactor* UnpinSequence(CallbackServerContext* context, const v1::UnpinSequenceRequest* request,
                                    v1::Sequence* response) override {
    return Pin(context, "UnpinSequence", request->name(), false, response);
  }

 private:
  ServerUnaryReactor* Pin(CallbackServerContext* context, std::string_view method, const std::string& name, bool pinned,
                          v1::Sequence* response) {
    return runtime_.Unary(context, method, name, [=, this](const Caller& caller) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string id, ParseSequenceName("name", name));
      ASSIGN_OR_RETURN(const SequenceRecord record, sequences_.Pin(caller.tenant, id, pinned));
      *response = Encode(record, jobs_.GetValidationProgress(id));
      return absl::OkStatus();
    });
  }

  v1::Sequence EncodeWithProgress(const SequenceRecord& record) {
    return Encode(record, record.state == SequenceState::kValidating ? jobs_.GetValidationProgress(record.id)
                                                                     : ValidationProgress{});
  }

  CallRuntime& runtime_;
  Sequences& sequences_;
  JobManager& jobs_;
  const LiveLimits& limits_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeSequenceService(CallRuntime& runtime, Sequences& sequences, JobManager& jobs,
                                                   const LiveLimits& limits) {
  return std::make_unique<SequenceService>(runtime, sequences, jobs, limits);
}

}  // namespace depthtween::server
