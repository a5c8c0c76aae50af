// Any bytes as a request's head, target, JSON body and gRPC-Web body: refused with a clear status, or a message that
// prints as JSON which reads back as the same message.
//
// The input is the target, a new line, and the body.
#include <google/protobuf/message.h>
#include <google/protobuf/util/message_differencer.h>

#include <cstdlib>
#include <memory>

#include "server/http/api.h"
#include "server/http/grpc_web.h"
#include "server/http/head.h"
#include "server/http/json_mapping.h"
#include "server/http/router.h"
#include "server/http/target.h"

using namespace depthtween::server;  // NOLINT(google-build-using-namespace): this file is one function

namespace {

using google::protobuf::Message;

std::unique_ptr<Message> New(const google::protobuf::Descriptor* type) {
  return std::unique_ptr<Message>(google::protobuf::MessageFactory::generated_factory()->GetPrototype(type)->New());
}

void CheckMapping(const ApiMethod& method, const HttpParts& parts) {
  const std::unique_ptr<Message> request = New(method.descriptor->input_type());
  const google::rpc::Status error = FillRequest(parts, request.get());
  if (error.code() != 0) {
    if (error.code() != 3 || error.message().empty()) std::abort();
    return;
  }
  const auto json = PrintJson(*request);
  if (!json.ok()) return;  // such as an Any whose type nobody knows
  const std::unique_ptr<Message> again = New(method.descriptor->input_type());
  if (FillRequest({.body_field = "*", .body = *json}, again.get()).code() != 0) std::abort();
  if (request->SerializeAsString() != again->SerializeAsString() &&
      !google::protobuf::util::MessageDifferencer::Equals(*request, *again)) {
    std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view input(reinterpret_cast<const char*>(data), size);
  const size_t line = std::min(input.find('\n'), input.size());
  const std::string body(input.substr(std::min(line + 1, size)));

  (void)CheckHeadBytes(input, 10);
  for (const bool text : {false, true}) {
    const GrpcWebForm form{.text = text, .content_type = ""};
    const auto message = ParseGrpcWebRequest(form, input);
    if (message.ok() && *ParseGrpcWebRequest(form, GrpcWebMessage(form, *message)) != *message) std::abort();
  }
  const auto target = ParseTarget(input.substr(0, line));
  if (!target.ok()) return 0;
  for (const std::string& segment : target->segments) {
    if (segment.empty() || segment == ".." || segment.find('/') != std::string::npos) std::abort();
  }
  static const std::vector<ApiMethod> methods = ApiMethods(ApiFiles());
  for (const ApiMethod& method : methods) {
    auto values = PathTemplate::Parse(method.path)->Match(target->segments);
    if (!values) continue;
    CheckMapping(method, {.body_field = method.body, .body = body, .path_values = *values, .query = target->query});
  }
  return 0;
}
