#include "server/http/errors.h"

#include <google/protobuf/stubs/common.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "google/rpc/error_details.pb.h"

namespace depthtween::server {
namespace {

// As server/rpc says it in its own errors.
constexpr char kHttpErrorDomain[] = "depthtween";

// Messages quote what clients sent; a string field of protobuf must be UTF-8.
std::string ReadableText(std::string_view text) {
  if (google::protobuf::internal::IsStructurallyValidUTF8(text.data(), static_cast<int>(text.size()))) {
    return std::string(text);
  }
  return absl::CHexEscape({text.data(), text.size()});
}

}  // namespace

int HttpStatusOf(int code) {
  switch (static_cast<absl::StatusCode>(code)) {
    case absl::StatusCode::kOk:
      return 200;
    case absl::StatusCode::kCancelled:
      return 499;  // "client closed request", as nginx says it
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
      return 400;
    case absl::StatusCode::kUnauthenticated:
      return 401;
    case absl::StatusCode::kPermissionDenied:
      return 403;
    case absl::StatusCode::kNotFound:
      return 404;
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kAborted:
      return 409;
    case absl::StatusCode::kResourceExhausted:
      return 429;
    case absl::StatusCode::kUnimplemented:
      return 501;
    case absl::StatusCode::kUnavailable:
      return 503;
    case absl::StatusCode::kDeadlineExceeded:
      return 504;
    case absl::StatusCode::kUnknown:
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kDataLoss:
    default:
      return 500;
  }
}

std::string_view HttpReason(int status) {
  switch (status) {
    case 100:
      return "Continue";
    case 200:
      return "OK";
    case 201:
      return "Created";
    case 204:
      return "No Content";
    case 206:
      return "Partial Content";
    case 304:
      return "Not Modified";
    case 400:
      return "Bad Request";
    case 401:
      return "Unauthorized";
    case 403:
      return "Forbidden";
    case 404:
      return "Not Found";
    case 405:
      return "Method Not Allowed";
    case 408:
      return "Request Timeout";
    case 409:
      return "Conflict";
    case 410:
      return "Gone";
    case 411:
      return "Length Required";
    case 412:
      return "Precondition Failed";
    case 413:
      return "Content Too Large";
    case 414:
      return "URI Too Long";
    case 415:
      return "Unsupported Media Type";
    case 416:
      return "Range Not Satisfiable";
    case 423:
      return "Locked";
    case 429:
      return "Too Many Requests";
    case 431:
      return "Request Header Fields Too Large";
    case 460:
      return "Checksum Mismatch";  // tus
    case 499:
      return "Client Closed Request";
    case 500:
      return "Internal Server Error";
    case 501:
      return "Not Implemented";
    case 503:
      return "Service Unavailable";
    case 504:
      return "Gateway Timeout";
    case 505:
      return "HTTP Version Not Supported";
    case 507:
      return "Insufficient Storage";
    default:
      return "Status";
  }
}

google::rpc::Status ErrorOf(const grpc::Status& status) {
  google::rpc::Status error;
  // A status of gRPC itself, such as a channel that is closed, has no details.
  if (!error.ParseFromString(status.error_details()) || error.code() != status.error_code()) {
    error.Clear();
    error.set_code(status.error_code());
    error.set_message(ReadableText(status.error_message()));
  }
  return error;
}

google::rpc::Status ErrorOf(const absl::Status& status, std::string_view reason) {
  google::rpc::Status error;
  error.set_code(static_cast<int>(status.code()));
  error.set_message(ReadableText({status.message().data(), status.message().size()}));
  google::rpc::ErrorInfo info;
  info.set_domain(kHttpErrorDomain);
  info.set_reason(reason.empty() ? absl::StatusCodeToString(status.code()) : std::string(reason));
  error.add_details()->PackFrom(info);
  return error;
}

google::rpc::Status FieldError(std::string_view field, std::string_view rule) {
  const std::string name = ReadableText(field);
  const std::string message = absl::StrCat(name, name.empty() ? "" : " ", ReadableText(rule));
  google::rpc::Status error = ErrorOf(absl::InvalidArgumentError(message), "BAD_FIELD");
  google::rpc::ErrorInfo info;
  error.details(0).UnpackTo(&info);
  (*info.mutable_metadata())["field"] = name;
  error.mutable_details(0)->PackFrom(info);
  google::rpc::BadRequest bad_request;
  auto* violation = bad_request.add_field_violations();
  violation->set_field(name);
  violation->set_description(message);
  error.add_details()->PackFrom(bad_request);
  return error;
}

std::string ErrorJson(const google::rpc::Status& error) {
  std::string json;
  if (google::protobuf::util::MessageToJsonString(error, &json).ok()) return json;
  // A detail of a type that this program does not know.
  google::rpc::Status plain;
  plain.set_code(error.code());
  plain.set_message(error.message());
  json.clear();
  (void)google::protobuf::util::MessageToJsonString(plain, &json);
  return json;
}

HttpResponse ErrorResponse(const google::rpc::Status& error) {
  HttpResponse response{.status = HttpStatusOf(error.code()),
                        .headers = {{"Content-Type", "application/json"}},
                        .body = absl::StrCat(ErrorJson(error), "\n")};
  if (response.status == 401) response.headers.emplace_back("WWW-Authenticate", "Bearer");
  for (const auto& any : error.details()) {
    google::rpc::RetryInfo retry;
    if (!any.UnpackTo(&retry)) continue;
    const auto& delay = retry.retry_delay();
    const int64_t seconds = std::max<int64_t>(1, delay.seconds() + (delay.nanos() > 0 ? 1 : 0));
    response.headers.emplace_back("Retry-After", absl::StrCat(seconds));
  }
  return response;
}

HttpResponse ErrorResponse(const grpc::Status& status) { return ErrorResponse(ErrorOf(status)); }
HttpResponse ErrorResponse(const absl::Status& status) { return ErrorResponse(ErrorOf(status)); }

HttpResponse ErrorResponse(int http_status, const absl::Status& status) {
  HttpResponse response = ErrorResponse(status);
  response.status = http_status;
  return response;
}

}  // namespace depthtween::server
