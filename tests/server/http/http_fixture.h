// A server as in rpc_fixture.h, and handlers of HTTP on its channel, without a socket.
#ifndef DEPTHTWEEN_TESTS_SERVER_HTTP_HTTP_FIXTURE_H_
#define DEPTHTWEEN_TESTS_SERVER_HTTP_HTTP_FIXTURE_H_

#include <boost/asio/io_context.hpp>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/str_split.h"
#include "server/http/calls.h"
#include "tests/server/http/fake_exchange.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {

class HttpHandlerTest : public RpcTest {
 protected:
  RpcChannel& rpc_channel() {
    if (rpc_channel_ == nullptr) rpc_channel_ = std::make_unique<RpcChannel>(channel());
    return *rpc_channel_;
  }

  // A request as the listener makes it. `path` without "/" in front.
  static HttpRequest Request(std::string method, const std::string& path, HttpHeaders headers = {}) {
    HttpRequest request;
    request.method = std::move(method);
    request.path = "/" + path;
    request.segments = absl::StrSplit(path, '/');
    request.headers = std::move(headers);
    request.content_length = 0;
    request.peer = "127.0.0.1:1";
    request.request_id = "test";
    return request;
  }

  boost::asio::io_context context;  // outlives the channel, whose calls report to it

 private:
  std::unique_ptr<RpcChannel> rpc_channel_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_HTTP_HTTP_FIXTURE_H_
