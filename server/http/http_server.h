// The HTTP listener: JSON, server-sent events and gRPC-Web in front of the server's own gRPC.
//
// HTTP/1.1 on its own threads and with its own limits. Whatever a request asks for becomes a call on the channel, so it
// passes the same guard as one that came over gRPC; this module knows neither services nor store.
#ifndef DEPTHTWEEN_SERVER_HTTP_HTTP_SERVER_H_
#define DEPTHTWEEN_SERVER_HTTP_HTTP_SERVER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/access/tls_files.h"

namespace grpc {
class Channel;
}

namespace depthtween::server {

class Router;
class RpcChannel;

struct HttpServerOptions {
  std::string listen = "127.0.0.1:8080";  // HOST:PORT; port 0: any free one
  // Calls need a token, and the operator lets anybody in: what CheckListenAddress asks about.
  bool tokens = false;
  bool insecure_listen_anywhere = false;
  // New connections use new files once they have changed; files that do not work are logged and the old ones stay.
  TlsFiles tls;
  // Origins of web pages whose scripts may use this server, such as "https://example.org"; or "*".
  std::vector<std::string> allowed_origins;
  // What requests may name in their Host header; empty: anything. See IsAllowedHost.
  std::vector<std::string> allowed_hosts;

  int threads = 4;
  int max_connections = 1000;        // beyond them: 503, or just closed under TLS
  int max_requests = 500;            // in flight, streams included; beyond them: 503
  size_t max_head_bytes = 16 << 10;  // request line and headers
  size_t max_headers = 100;
  size_t max_target_bytes = 8 << 10;  // of the request line
  size_t max_json_bytes = 4 << 20;    // a body that becomes a message
  absl::Duration handshake_timeout = absl::Seconds(10);
  absl::Duration idle_timeout = absl::Seconds(30);      // between requests
  absl::Duration head_timeout = absl::Seconds(10);      // from the first byte of a request to the end of its head
  absl::Duration body_timeout = absl::Seconds(30);      // for each part of a body
  absl::Duration write_timeout = absl::Seconds(30);     // for each part of an answer that the client takes
  absl::Duration stream_heartbeat = absl::Seconds(15);  // comments in server-sent events
  absl::Duration gone_check = absl::Seconds(1);  // how often a waiting request asks whether its client is still there

  absl::Status Validate() const;
};

class HttpServer {
 public:
  // Binds the port and starts to serve. InvalidArgument: options, or TLS files that do not work. FailedPrecondition:
  // the address cannot be bound.
  static absl::StatusOr<std::unique_ptr<HttpServer>> Start(const HttpServerOptions& options,
                                                           std::shared_ptr<grpc::Channel> channel);
  // With routes beside those that every server has. `add_routes` is called once, before the first request; what it
  // captures must outlive the server.
  using AddRoutes = std::function<void(Router&, RpcChannel&)>;
  static absl::StatusOr<std::unique_ptr<HttpServer>> Start(const HttpServerOptions& options,
                                                           std::shared_ptr<grpc::Channel> channel,
                                                           const AddRoutes& add_routes);
  // Stops without patience, unless Stop was called.
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  // The bound port.
  int port() const;

  // No new connections and, on old ones, no new requests; requests in flight go on. Call it before the gRPC server
  // stops, so that streams can still say why they end.
  void Drain();
  // Drain, then cut what has not ended after `patience`. Returns when no request is left.
  void Stop(absl::Duration patience);

 private:
  class Impl;
  explicit HttpServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_HTTP_SERVER_H_
