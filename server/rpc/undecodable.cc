#include "server/rpc/undecodable.h"

#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/server_context.h>

#include <optional>
#include <string>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

using grpc::experimental::InterceptionHookPoints;
using grpc::experimental::InterceptorBatchMethods;
using grpc::experimental::ServerRpcInfo;

constexpr std::string_view kOurPackage = "/depthtween.v1.";

absl::Status Undecodable() {
  return WithErrorInfo(absl::InvalidArgumentError("the request cannot be decoded: its bytes are not a message of this "
                                                  "method; see the .proto files, or reflection"),
                       {.reason = "BAD_MESSAGE"});
}

// "/depthtween.v1.JobService/GetJob" -> "GetJob", and of health "Health.Check".
std::string NameOfMethod(std::string_view path) {
  const std::string_view name = path.substr(path.rfind('/') + 1);
  return absl::StrCat(path.substr(0, kOurPackage.size()) == kOurPackage ? "" : "Health.", View(name));
}

class UndecodableAnswer : public grpc::experimental::Interceptor {
 public:
  UndecodableAnswer(CallRuntime& runtime, ServerRpcInfo& info) : runtime_(runtime), info_(info) {}

  void Intercept(InterceptorBatchMethods* methods) override {
    if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE) &&
        methods->GetRecvMessage() == nullptr) {
      AnswerCall();
    }
    if (answer_ && methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) {
      methods->ModifySendStatus(*answer_);
    }
    methods->Proceed();
  }

 private:
  void AnswerCall() {
    const std::string name = NameOfMethod(info_.method());
    const bool stream = info_.type() == ServerRpcInfo::Type::SERVER_STREAMING;
    const CallKind kind = name.rfind("Health.", 0) == 0 ? CallKind::kHealth
                          : stream                      ? CallKind::kStream
                                                        : CallKind::kCall;
    const Call call(runtime_, static_cast<grpc::CallbackServerContext*>(info_.server_context()), kind, name, "");
    answer_ = call.Answer(call.admission().ok() ? Undecodable() : call.admission());
  }

  CallRuntime& runtime_;
  ServerRpcInfo& info_;
  std::optional<grpc::Status> answer_;
};

class UndecodableAnswers : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit UndecodableAnswers(CallRuntime& runtime) : runtime_(runtime) {}

  grpc::experimental::Interceptor* CreateServerInterceptor(ServerRpcInfo* info) override {
    // The end of a stream of requests looks just like a request that cannot be decoded.
    const bool one_request =
        info->type() == ServerRpcInfo::Type::UNARY || info->type() == ServerRpcInfo::Type::SERVER_STREAMING;
    return one_request ? new UndecodableAnswer(runtime_, *info) : nullptr;  // gRPC owns it
  }

 private:
  CallRuntime& runtime_;
};

}  // namespace

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> MakeUndecodableAnswers(CallRuntime& runtime) {
  return std::make_unique<UndecodableAnswers>(runtime);
}

absl::Status DecodeMessage(grpc::ByteBuffer& bytes, google::protobuf::MessageLite& message) {
  grpc::ProtoBufferReader reader(&bytes);
  const bool decoded = message.ParseFromZeroCopyStream(&reader) && reader.status().ok();
  bytes.Clear();
  return decoded ? absl::OkStatus() : Undecodable();
}

}  // namespace depthtween::server
