#include "server/http/grpc_web.h"

#include <google/protobuf/descriptor.h>
#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "server/http/errors.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;

constexpr size_t kFrameHeadBytes = 5;
constexpr unsigned char kCompressedFlag = 0x01, kTrailersFlag = 0x80;

std::string Frame(unsigned char flags, std::string_view bytes) {
  const auto size = static_cast<uint32_t>(bytes.size());
  std::string frame;
  frame.reserve(kFrameHeadBytes + bytes.size());
  frame.push_back(static_cast<char>(flags));
  for (int shift = 24; shift >= 0; shift -= 8) frame.push_back(static_cast<char>((size >> shift) & 0xff));
  frame.append(bytes);
  return frame;
}

std::string Encoded(const GrpcWebForm& form, std::string frame) {
  return form.text ? absl::Base64Escape(frame) : frame;
}

// grpc-message is percent-encoded: all but printable ASCII, and the percent sign.
std::string PercentEncode(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c >= ' ' && c <= '~' && c != '%') {
      result.push_back(c);
    } else {
      absl::StrAppend(&result, "%", absl::Hex(static_cast<unsigned char>(c), absl::kZeroPad2));
    }
  }
  return result;
}

std::string FlatBytes(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  (void)buffer.Dump(&slices);
  std::string bytes;
  bytes.reserve(buffer.Length());
  for (const grpc::Slice& slice : slices) bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  return bytes;
}

struct GrpcWebRoute {
  std::string rpc;
  bool server_streaming = false;
  RpcChannel& channel;
  size_t max_bytes;
};

// As gRPC answers: the status of HTTP is 200, and the call's own is in the trailers.
asio::awaitable<void> AnswerGrpcWebError(const GrpcWebForm& form, const absl::Status& error, Exchange& exchange) {
  const google::rpc::Status details = ErrorOf(error);
  const grpc::Status status(static_cast<grpc::StatusCode>(details.code()), details.message(),
                            details.SerializeAsString());
  HttpResponse response{.headers = {{"Content-Type", form.content_type}}, .body = GrpcWebTrailers(form, status)};
  (void)co_await exchange.Respond(std::move(response));
}

asio::awaitable<void> AnswerGrpcWeb(std::shared_ptr<const GrpcWebRoute> route, Exchange& exchange) {
  const std::optional<GrpcWebForm> form = ParseGrpcWebType(exchange.request().Header("Content-Type").value_or(""));
  if (!form) {
    HttpResponse response = ErrorResponse(
        415, absl::InvalidArgumentError("this path speaks gRPC-Web: Content-Type must be application/grpc-web+proto or "
                                        "application/grpc-web-text; for JSON see /openapi.json"));
    (void)co_await exchange.Respond(std::move(response));
    co_return;
  }
  const std::optional<std::string> timeout = exchange.request().Header("grpc-timeout");
  if (timeout && !ParseGrpcTimeout(*timeout)) {
    const absl::Status wrong =
        absl::InvalidArgumentError("grpc-timeout must be up to 8 digits and a unit: H, M, S, m, u or n, such as 10S");
    co_await AnswerGrpcWebError(*form, wrong, exchange);
    co_return;
  }
  absl::StatusOr<std::string> body = co_await exchange.ReadBody(route->max_bytes);
  absl::StatusOr<std::string> message = body.ok() ? ParseGrpcWebRequest(*form, *body) : body.status();
  if (!message.ok()) {
    co_await AnswerGrpcWebError(*form, message.status(), exchange);
    co_return;
  }
  const grpc::Slice slice(message->data(), message->size());
  grpc::ByteBuffer request(&slice, 1);
  if (!route->server_streaming) {
    grpc::ByteBuffer answer;
    const grpc::Status status = co_await CallUnary(route->channel, exchange, route->rpc, std::move(request), &answer);
    HttpResponse response{.headers = {{"Content-Type", form->content_type}}};
    if (status.ok()) response.body = GrpcWebMessage(*form, FlatBytes(answer));
    response.body += GrpcWebTrailers(*form, status);
    (void)co_await exchange.Respond(std::move(response));
    co_return;
  }
  RpcCall call(route->channel, exchange, route->rpc);
  (void)co_await call.WriteLast(std::move(request));
  HttpHeaders headers = {{"Content-Type", form->content_type}, {"X-Accel-Buffering", "no"}};
  absl::Status written = co_await exchange.StartBody(200, std::move(headers), std::nullopt);
  grpc::ByteBuffer answer;
  bool more = written.ok();
  while (more) {
    more = co_await call.Read(&answer);
    if (!more) break;
    const std::string frame = GrpcWebMessage(*form, FlatBytes(answer));
    written = co_await exchange.Write(frame);
    more = written.ok();
  }
  if (!written.ok()) co_return;
  const grpc::Status status = co_await call.Finish();
  const std::string trailers = GrpcWebTrailers(*form, status);
  (void)co_await exchange.Write(trailers);
  (void)co_await exchange.End();
}

asio::awaitable<void> AnswerGrpcWebClientStream(Exchange& exchange) {
  HttpResponse response = ErrorResponse(
      405, absl::UnimplementedError("gRPC-Web cannot stream to the server; upload by the tus protocol, or over gRPC"));
  response.headers.emplace_back("Allow", "OPTIONS");
  (void)co_await exchange.Respond(std::move(response));
}

}  // namespace

std::optional<GrpcWebForm> ParseGrpcWebType(std::string_view content_type) {
  const std::string type(absl::StripAsciiWhitespace(
      absl::string_view(content_type.data(), std::min(content_type.find(';'), content_type.size()))));
  for (const bool text : {false, true}) {
    const std::string base = text ? "application/grpc-web-text" : "application/grpc-web";
    if (absl::EqualsIgnoreCase(type, base) || absl::EqualsIgnoreCase(type, base + "+proto")) {
      return GrpcWebForm{.text = text, .content_type = base + "+proto"};
    }
  }
  return std::nullopt;
}

std::optional<std::string> DecodeBase64Pieces(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    // A piece ends with its padding, or with the text.
    size_t end = text.find('=');
    end = end == std::string_view::npos ? text.size() : text.find_first_not_of('=', end);
    end = std::min(end, text.size());
    std::string piece;
    if (end % 4 != 0 || !absl::Base64Unescape({text.data(), end}, &piece)) return std::nullopt;
    result += piece;
    text.remove_prefix(end);
  }
  return result;
}

absl::StatusOr<std::string> ParseGrpcWebRequest(const GrpcWebForm& form, std::string_view body) {
  std::optional<std::string> bytes = form.text ? DecodeBase64Pieces(body) : std::string(body);
  if (!bytes) return absl::InvalidArgumentError("the request's body is not base64");
  if (bytes->size() < kFrameHeadBytes) return absl::InvalidArgumentError("the request's body is shorter than a frame");
  const auto flags = static_cast<unsigned char>((*bytes)[0]);
  if ((flags & kCompressedFlag) != 0) return absl::UnimplementedError("compressed messages are not taken");
  size_t size = 0;
  for (size_t i = 1; i < kFrameHeadBytes; ++i) size = size << 8 | static_cast<unsigned char>((*bytes)[i]);
  if (flags != 0 || size != bytes->size() - kFrameHeadBytes) {
    return absl::InvalidArgumentError("the request's body must be one frame with a message, no more and no less");
  }
  return bytes->substr(kFrameHeadBytes);
}

std::string GrpcWebMessage(const GrpcWebForm& form, std::string_view message) {
  return Encoded(form, Frame(0, message));
}

std::string GrpcWebTrailers(const GrpcWebForm& form, const grpc::Status& status) {
  std::string trailers = absl::StrCat("grpc-status:", static_cast<int>(status.error_code()), "\r\n");
  if (!status.error_message().empty()) {
    absl::StrAppend(&trailers, "grpc-message:", PercentEncode(status.error_message()), "\r\n");
  }
  if (!status.error_details().empty()) {
    // Binary metadata goes without padding.
    std::string details = absl::Base64Escape(status.error_details());
    details.erase(details.find_last_not_of('=') + 1);
    absl::StrAppend(&trailers, "grpc-status-details-bin:", details, "\r\n");
  }
  return Encoded(form, Frame(kTrailersFlag, trailers));
}

void AddGrpcWeb(Router& router, RpcChannel& channel,
                const std::vector<const google::protobuf::ServiceDescriptor*>& services,
                const HttpServerOptions& options) {
  for (const auto* service : services) {
    for (int m = 0; m < service->method_count(); ++m) {
      const auto* method = service->method(m);
      const std::string rpc = absl::StrCat("/", service->full_name(), "/", method->name());
      if (method->client_streaming()) {
        router.Add("POST", rpc, AnswerGrpcWebClientStream);
        continue;
      }
      // Base64 is a third longer than what it holds.
      const auto route = std::make_shared<const GrpcWebRoute>(
          GrpcWebRoute{.rpc = rpc,
                       .server_streaming = method->server_streaming(),
                       .channel = channel,
                       .max_bytes = options.max_json_bytes + options.max_json_bytes / 2 + kFrameHeadBytes});
      router.Add("POST", rpc, [route](Exchange& exchange) { return AnswerGrpcWeb(route, exchange); });
    }
  }
}

}  // namespace depthtween::server
