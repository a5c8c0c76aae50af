#include "server/http/bridge.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <memory>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/http/errors.h"
#include "server/http/json_mapping.h"
#include "server/http/streams.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// What a route needs; it is kept by its handler.
struct BridgeRoute {
  ApiMethod method;
  RpcChannel& channel;
  size_t max_json_bytes;
  absl::Duration heartbeat;
};

std::unique_ptr<Message> NewMessage(const google::protobuf::Descriptor* type) {
  return std::unique_ptr<Message>(google::protobuf::MessageFactory::generated_factory()->GetPrototype(type)->New());
}

const FieldDescriptor* ResumeToken(const google::protobuf::Descriptor* type) {
  const FieldDescriptor* field = type->FindFieldByName("resume_token");
  return field != nullptr && field->type() == FieldDescriptor::TYPE_STRING && !field->is_repeated() ? field : nullptr;
}

// The request's message, or the answer that says what is wrong with it.
asio::awaitable<std::optional<HttpResponse>> ReadRequest(const BridgeRoute& route, Exchange& exchange,
                                                         Message* message) {
  const HttpRequest& request = exchange.request();
  HttpParts parts{.body_field = route.method.body, .path_values = request.path_values, .query = request.query};
  absl::StatusOr<std::string> body = co_await exchange.ReadBody(route.max_json_bytes);
  if (!body.ok()) {
    if (absl::IsResourceExhausted(body.status())) co_return ErrorResponse(413, body.status());
    if (absl::IsDeadlineExceeded(body.status())) co_return ErrorResponse(408, body.status());
    co_return ErrorResponse(body.status());
  }
  // A form of another page can send text, but not this type without being allowed to.
  const std::string type = request.Header("Content-Type").value_or("application/json");
  if (!body->empty() && !Accepts(type, "application/json")) {
    co_return ErrorResponse(415, absl::InvalidArgumentError("the body must have Content-Type: application/json"));
  }
  parts.body = *std::move(body);
  if (const google::rpc::Status error = FillRequest(parts, message); error.code() != 0) co_return ErrorResponse(error);
  const auto last_event = request.Header("Last-Event-ID");
  if (const FieldDescriptor* field = ResumeToken(message->GetDescriptor());
      field != nullptr && last_event && !last_event->empty() && route.method.descriptor->server_streaming()) {
    message->GetReflection()->SetString(message, field, *last_event);
  }
  co_return std::nullopt;
}

asio::awaitable<void> AnswerUnary(std::shared_ptr<const BridgeRoute> route, Exchange& exchange) {
  const std::unique_ptr<Message> request = NewMessage(route->method.descriptor->input_type());
  std::optional<HttpResponse> refused = co_await ReadRequest(*route, exchange, request.get());
  if (refused) {
    (void)co_await exchange.Respond(*std::move(refused));
    co_return;
  }
  const std::unique_ptr<Message> answer = NewMessage(route->method.descriptor->output_type());
  const grpc::Status status = co_await CallUnary(route->channel, exchange, route->method.rpc, *request, answer.get());
  HttpResponse response{.headers = {{"Content-Type", "application/json"}}};
  if (status.ok()) {
    absl::StatusOr<std::string> json = PrintJson(*answer);
    if (json.ok()) {
      response.body = absl::StrCat(*json, "\n");
    } else {
      response = ErrorResponse(json.status());
    }
  } else {
    response = ErrorResponse(status);
  }
  (void)co_await exchange.Respond(std::move(response));
}

// How one stream is written.
struct StreamForm {
  bool sse = false;

  std::string MessageText(const Message& message) const {
    absl::StatusOr<std::string> json = PrintJson(message);
    if (!json.ok()) return ErrorText(ErrorOf(json.status()));
    if (!sse) return NdjsonMessage(*json);
    const FieldDescriptor* token = ResumeToken(message.GetDescriptor());
    return SseMessage(token == nullptr ? "" : message.GetReflection()->GetString(message, token), *json);
  }
  std::string ErrorText(const google::rpc::Status& error) const { return sse ? SseError(error) : NdjsonError(error); }
  std::string EndText() const { return sse ? SseEnd() : ""; }
  HttpHeaders Headers() const {
    if (!sse) return {{"Content-Type", "application/x-ndjson"}};
    // The last is for nginx, which would hold events back until it has a buffer full of them.
    return {
        {"Content-Type", "text/event-stream"}, {"Cache-Control", "no-cache, no-store"}, {"X-Accel-Buffering", "no"}};
  }
};

asio::awaitable<void> AnswerStream(std::shared_ptr<const BridgeRoute> route, Exchange& exchange) {
  const std::unique_ptr<Message> request = NewMessage(route->method.descriptor->input_type());
  std::optional<HttpResponse> refused = co_await ReadRequest(*route, exchange, request.get());
  if (refused) {
    (void)co_await exchange.Respond(*std::move(refused));
    co_return;
  }
  const StreamForm form{.sse = Accepts(exchange.request().Header("Accept").value_or(""), "text/event-stream")};
  const bool head_only = exchange.request().method == "HEAD";
  const std::unique_ptr<Message> message = NewMessage(route->method.descriptor->output_type());
  RpcCall call(route->channel, exchange, route->method.rpc);
  (void)co_await call.WriteLast(*request);

  // An error that comes first is the answer. What is slow to come must not keep the client without a head.
  std::optional<bool> read = co_await call.ReadWithin(route->heartbeat, message.get());
  if (read && !*read) {
    const grpc::Status status = co_await call.Finish();
    if (!status.ok() || form.sse) {
      HttpResponse response = status.ok() ? HttpResponse{.status = 204} : ErrorResponse(status);
      (void)co_await exchange.Respond(std::move(response));
      co_return;
    }
    HttpResponse empty{.headers = form.Headers()};
    (void)co_await exchange.Respond(std::move(empty));
    co_return;
  }
  HttpHeaders headers = form.Headers();
  absl::Status written = co_await exchange.StartBody(200, std::move(headers), std::nullopt);
  while (written.ok() && !head_only && !(read && !*read)) {
    std::string text;
    if (read) {
      text = form.MessageText(*message);
    } else if (form.sse) {
      text = SseHeartbeat();
    }
    written = co_await exchange.Write(text);
    if (written.ok()) read = co_await call.ReadWithin(route->heartbeat, message.get());
  }
  if (!written.ok() || head_only) {
    call.Cancel();
    if (written.ok()) (void)co_await exchange.End();
    co_return;
  }
  const grpc::Status status = co_await call.Finish();
  const std::string last = status.ok() ? form.EndText() : form.ErrorText(ErrorOf(status));
  (void)co_await exchange.Write(last);
  (void)co_await exchange.End();
}

asio::awaitable<void> AnswerClientStream(Exchange& exchange) {
  HttpResponse response = ErrorResponse(
      405, absl::UnimplementedError("this method streams to the server, which JSON cannot; upload over HTTP by the tus "
                                    "protocol at the upload's name with :tus, or over gRPC"));
  response.headers.emplace_back("Allow", "OPTIONS");
  (void)co_await exchange.Respond(std::move(response));
}

}  // namespace

void AddBridge(Router& router, RpcChannel& channel, const std::vector<ApiMethod>& methods,
               const HttpServerOptions& options) {
  for (const ApiMethod& method : methods) {
    const auto route = std::make_shared<const BridgeRoute>(BridgeRoute{.method = method,
                                                                       .channel = channel,
                                                                       .max_json_bytes = options.max_json_bytes,
                                                                       .heartbeat = options.stream_heartbeat});
    HttpHandler handler;
    if (method.descriptor->client_streaming()) {
      handler = AnswerClientStream;
    } else if (method.descriptor->server_streaming()) {
      handler = [route](Exchange& exchange) { return AnswerStream(route, exchange); };
    } else {
      handler = [route](Exchange& exchange) { return AnswerUnary(route, exchange); };
    }
    router.Add(method.http_method, method.path, std::move(handler));
  }
}

}  // namespace depthtween::server
