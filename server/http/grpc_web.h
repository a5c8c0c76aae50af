// gRPC-Web: the frames of gRPC in HTTP/1.1 bodies, so that pages call the same methods with generated clients.
// https://github.com/grpc/grpc/blob/master/doc/PROTOCOL-WEB.md
//
//   body    = *(frame)                 frame = flags(1) length(4, big-endian) bytes(length)
//   flags   = 0x00 a message, 0x80 the trailers, which come last: "grpc-status: 0\r\n..."
//   -text   = the same in base64, in pieces that may each be padded
//
// Requests of unary and server-streaming methods: one message each. Compressed messages are not taken.
#ifndef DEPTHTWEEN_SERVER_HTTP_GRPC_WEB_H_
#define DEPTHTWEEN_SERVER_HTTP_GRPC_WEB_H_

#include <grpcpp/support/status.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "server/http/api.h"
#include "server/http/calls.h"
#include "server/http/http_server.h"
#include "server/http/router.h"

namespace depthtween::server {

struct GrpcWebForm {
  bool text = false;         // base64
  std::string content_type;  // of the answer: what the request has
};
// nullopt: a Content-Type that is none of gRPC-Web with protobuf.
std::optional<GrpcWebForm> ParseGrpcWebType(std::string_view content_type);

// The one message of a request's body. InvalidArgument: not one whole frame with a message; Unimplemented: compressed.
absl::StatusOr<std::string> ParseGrpcWebRequest(const GrpcWebForm& form, std::string_view body);
// Decodes base64 that consists of pieces with their own padding.
std::optional<std::string> DecodeBase64Pieces(std::string_view text);

std::string GrpcWebMessage(const GrpcWebForm& form, std::string_view message);
std::string GrpcWebTrailers(const GrpcWebForm& form, const grpc::Status& status);

// POST /package.Service/Method for every unary and server-streaming method of these services, and a 405 for others.
// `channel` must outlive the router.
void AddGrpcWeb(Router& router, RpcChannel& channel,
                const std::vector<const google::protobuf::ServiceDescriptor*>& services,
                const HttpServerOptions& options);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_GRPC_WEB_H_
