// Every annotated method of depthtween.v1 as a route.
//
//   unary              JSON in, JSON out
//   server-streaming   by Accept: text/event-stream, or application/x-ndjson, which is also what others get.
//   Last-Event-ID
//                      becomes the request's resume_token. A stream that fails before its first message is answered
//                      with its status; an event stream that is over before its first message with 204, at which
//                      browsers stop to connect again
//   client-streaming   405: bytes are uploaded otherwise
#ifndef DEPTHTWEEN_SERVER_HTTP_BRIDGE_H_
#define DEPTHTWEEN_SERVER_HTTP_BRIDGE_H_

#include "server/http/api.h"
#include "server/http/calls.h"
#include "server/http/http_server.h"
#include "server/http/router.h"

namespace depthtween::server {

// `channel` must outlive the router.
void AddBridge(Router& router, RpcChannel& channel, const std::vector<ApiMethod>& methods,
               const HttpServerOptions& options);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_BRIDGE_H_
