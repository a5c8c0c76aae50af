// Errors as HTTP answers: the body is google.rpc.Status as protobuf's JSON, with its details spelled out by "@type";
// the status line follows google.rpc.Code.
#ifndef DEPTHTWEEN_SERVER_HTTP_ERRORS_H_
#define DEPTHTWEEN_SERVER_HTTP_ERRORS_H_

#include <grpcpp/support/status.h>

#include <string>
#include <string_view>

#include "core/base/status.h"
#include "google/rpc/status.pb.h"
#include "server/http/exchange.h"

namespace depthtween::server {

// The status code of HTTP for a google.rpc.Code; 500 for what is none.
int HttpStatusOf(int code);
// The reason phrase, "Not Found".
std::string_view HttpReason(int status);

// What a failed call says, with its details.
google::rpc::Status ErrorOf(const grpc::Status& status);
// An error found here. The detail is an ErrorInfo of our domain; its reason is the name of the code unless given.
google::rpc::Status ErrorOf(const absl::Status& status, std::string_view reason = "");
// INVALID_ARGUMENT about a field, with a BadRequest: "<field> <rule>".
google::rpc::Status FieldError(std::string_view field, std::string_view rule);

std::string ErrorJson(const google::rpc::Status& error);

// 401 adds WWW-Authenticate: Bearer; a RetryInfo adds Retry-After, in whole seconds and at least 1.
HttpResponse ErrorResponse(const google::rpc::Status& error);
HttpResponse ErrorResponse(const grpc::Status& status);
HttpResponse ErrorResponse(const absl::Status& status);
// For what HTTP tells apart and google.rpc.Code does not, such as 405 and 413.
HttpResponse ErrorResponse(int http_status, const absl::Status& status);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_ERRORS_H_
