#include "server/http/http_server.h"

#include <sys/socket.h>

#include <algorithm>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "grpc/health/v1/health.pb.h"
#include "server/access/listen_address.h"
#include "server/http/api.h"
#include "server/http/bridge.h"
#include "server/http/calls.h"
#include "server/http/cors.h"
#include "server/http/file_service.h"
#include "server/http/grpc_web.h"
#include "server/http/openapi.h"
#include "server/http/probes.h"
#include "server/http/session.h"
#include "server/http/tls_context.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;
using Tcp = asio::ip::tcp;

// Between two tries to accept when the system has no file descriptor or memory to spare.
constexpr absl::Duration kAcceptPause = absl::Milliseconds(100);
constexpr absl::Duration kAcceptComplaint = absl::Minutes(1);

constexpr char kTooManyConnections[] =
    "HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";

std::string TextOf(const Tcp::endpoint& endpoint) {
  const std::string host = endpoint.address().to_string();
  return endpoint.address().is_v6() ? absl::StrCat("[", host, "]:", endpoint.port())
                                    : absl::StrCat(host, ":", endpoint.port());
}

std::vector<const google::protobuf::ServiceDescriptor*> GrpcWebServices() {
  std::vector<const google::protobuf::FileDescriptor*> files = ApiFiles();
  files.push_back(grpc::health::v1::HealthCheckRequest::descriptor()->file());
  std::vector<const google::protobuf::ServiceDescriptor*> services;
  for (const auto* file : files) {
    for (int i = 0; i < file->service_count(); ++i) services.push_back(file->service(i));
  }
  return services;
}

absl::Status AtLeastOne(std::string_view field, int64_t value) {
  if (value >= 1) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s = %d, must be >= 1", std::string(field), value));
}

absl::Status LongerThanNothing(std::string_view field, absl::Duration value) {
  if (value > absl::ZeroDuration()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s = %s, must be > 0", std::string(field), absl::FormatDuration(value)));
}

absl::StatusOr<Tcp::endpoint> Resolve(asio::io_context& context, const std::string& listen) {
  ASSIGN_OR_RETURN(const ListenAddress address, ParseListenAddress(listen));
  Tcp::resolver resolver(context);
  boost::system::error_code error;
  const auto results = resolver.resolve(address.host, absl::StrCat(address.port), Tcp::resolver::passive, error);
  if (error || results.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("listen = \"%s\": there is no such host: %s", listen, error.message()));
  }
  return results.begin()->endpoint();
}

}  // namespace

absl::Status HttpServerOptions::Validate() const {
  RETURN_IF_ERROR(AtLeastOne("threads", threads));
  RETURN_IF_ERROR(AtLeastOne("max_connections", max_connections));
  RETURN_IF_ERROR(AtLeastOne("max_requests", max_requests));
  RETURN_IF_ERROR(AtLeastOne("max_head_bytes", static_cast<int64_t>(max_head_bytes)));
  RETURN_IF_ERROR(AtLeastOne("max_headers", static_cast<int64_t>(max_headers)));
  RETURN_IF_ERROR(AtLeastOne("max_target_bytes", static_cast<int64_t>(max_target_bytes)));
  RETURN_IF_ERROR(AtLeastOne("max_json_bytes", static_cast<int64_t>(max_json_bytes)));
  RETURN_IF_ERROR(LongerThanNothing("handshake_timeout", handshake_timeout));
  RETURN_IF_ERROR(LongerThanNothing("idle_timeout", idle_timeout));
  RETURN_IF_ERROR(LongerThanNothing("head_timeout", head_timeout));
  RETURN_IF_ERROR(LongerThanNothing("body_timeout", body_timeout));
  RETURN_IF_ERROR(LongerThanNothing("write_timeout", write_timeout));
  RETURN_IF_ERROR(LongerThanNothing("stream_heartbeat", stream_heartbeat));
  RETURN_IF_ERROR(LongerThanNothing("gone_check", gone_check));
  if (IsUnixSocket(listen)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("listen = \"%s\": HTTP listens only on HOST:PORT such as 127.0.0.1:8080", listen));
  }
  RETURN_IF_ERROR(CheckListenAddress(
      listen, {.tls = tls.enabled(), .tokens = tokens, .insecure_anywhere = insecure_listen_anywhere}));
  for (const std::string& origin : allowed_origins) {
    if (!IsOrigin(origin)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "allowed_origins has \"%s\", must be a scheme and a host such as https://example.org, or *", origin));
    }
  }
  return tls.enabled() ? CheckTlsFiles(tls) : absl::OkStatus();
}

class HttpServer::Impl {
 public:
  Impl(const HttpServerOptions& options, std::shared_ptr<grpc::Channel> channel)
      : channel_(std::move(channel)), acceptor_(asio::make_strand(context_)) {
    shared_.options = options;
  }

  ~Impl() { Stop(absl::ZeroDuration()); }

  absl::Status Start(const AddRoutes& add_routes) {
    const HttpServerOptions& options = shared_.options;
    if (options.tls.enabled()) {
      ASSIGN_OR_RETURN(tls_, TlsContext::Load(options.tls));
    }
    AddProbes(shared_.router, channel_);
    AddFileRoutes(shared_.router, channel_);
    AddBridge(shared_.router, channel_, ApiMethods(ApiFiles()), options);
    AddGrpcWeb(shared_.router, channel_, GrpcWebServices(), options);
    RETURN_IF_ERROR(AddOpenApi(shared_.router));
    if (add_routes) add_routes(shared_.router, channel_);
    ASSIGN_OR_RETURN(const Tcp::endpoint endpoint, Resolve(context_, options.listen));
    RETURN_IF_ERROR(Bind(endpoint));
    asio::co_spawn(acceptor_.get_executor(), Accept(), asio::detached);
    for (int i = 0; i < options.threads; ++i) {
      threads_.emplace_back([this] { context_.run(); });
    }
    return absl::OkStatus();
  }

  int port() const { return port_; }

  void Drain() {
    if (threads_.empty()) return;
    shared_.draining = true;
    asio::post(acceptor_.get_executor(), [this] {
      boost::system::error_code ignored;
      acceptor_.close(ignored);
    });
    for (const auto& session : Sessions()) session->Drain();
  }

  void Stop(absl::Duration patience) {
    if (threads_.empty()) return;
    Drain();
    {
      std::unique_lock lock(mutex_);
      none_left_.wait_for(lock, absl::ToChronoNanoseconds(patience), [this] { return sessions_.empty(); });
    }
    for (const auto& session : Sessions()) session->Cut();
    {
      std::unique_lock lock(mutex_);
      none_left_.wait(lock, [this] { return sessions_.empty(); });
    }
    work_.reset();
    threads_.clear();  // joins
  }

 private:
  absl::Status Bind(const Tcp::endpoint& endpoint) {
    boost::system::error_code error;
    acceptor_.open(endpoint.protocol(), error);
    if (!error) acceptor_.set_option(Tcp::acceptor::reuse_address(true), error);
    if (!error) acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    if (error) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "cannot listen for HTTP on %s: %s. Is another server running there? If not, HOST is not an address of this "
          "machine (--http-listen HOST:0 takes any free port)",
          shared_.options.listen, error.message()));
    }
    port_ = acceptor_.local_endpoint(error).port();
    return absl::OkStatus();
  }

  asio::awaitable<void> Accept() {
    absl::Time complained = absl::InfinitePast();
    asio::steady_timer pause(acceptor_.get_executor());
    while (acceptor_.is_open()) {
      auto [error, socket] =
          co_await acceptor_.async_accept(asio::make_strand(context_), asio::as_tuple(asio::use_awaitable));
      if (!acceptor_.is_open()) co_return;
      if (!error) {
        Welcome(std::move(socket));
        continue;
      }
      if (error == asio::error::connection_aborted) continue;  // it went before we came to it
      // Without file descriptors or memory the connection stays in the system's queue: trying at once would spin.
      if (absl::Now() - complained > kAcceptComplaint) {
        complained = absl::Now();
        LogWarning("http_accept", {{"why", error.message()}});
      }
      pause.expires_after(absl::ToChronoNanoseconds(kAcceptPause));
      co_await pause.async_wait(asio::as_tuple(asio::use_awaitable));
    }
  }

  void Welcome(Tcp::socket socket) {
    boost::system::error_code error;
    const Tcp::endpoint endpoint = socket.remote_endpoint(error);
    if (error) return;
    std::shared_ptr<Session> session;
    const uint64_t number = next_session_++;
    {
      const std::lock_guard lock(mutex_);
      if (static_cast<int>(sessions_.size()) < shared_.options.max_connections && !shared_.draining) {
        session = std::make_shared<Session>(
            shared_, MakeTransport(std::move(socket), tls_ == nullptr ? nullptr : tls_->Current()), TextOf(endpoint));
        sessions_[number] = session;
      }
    }
    if (session == nullptr) {
      if (tls_ == nullptr) {
        // A new socket's buffer takes this without waiting. What is unread would turn the close into a reset.
        (void)::send(socket.native_handle(), kTooManyConnections, sizeof(kTooManyConnections) - 1,
                     MSG_NOSIGNAL | MSG_DONTWAIT);
        socket.shutdown(Tcp::socket::shutdown_send, error);
      }
      return;
    }
    const auto executor = session->executor();
    asio::co_spawn(executor, Session::Run(std::move(session)), [this, number](const std::exception_ptr& exception) {
      if (exception) LogError("http_session", {{"why", WhatOf(exception)}});
      const std::lock_guard lock(mutex_);
      sessions_.erase(number);
      if (sessions_.empty()) none_left_.notify_all();
    });
  }

  static std::string WhatOf(const std::exception_ptr& exception) {
    try {
      std::rethrow_exception(exception);
    } catch (const std::exception& known) {
      return known.what();
    } catch (...) {
      return "unknown";
    }
  }

  std::vector<std::shared_ptr<Session>> Sessions() {
    const std::lock_guard lock(mutex_);
    std::vector<std::shared_ptr<Session>> result;
    for (const auto& [number, session] : sessions_) result.push_back(session);
    return result;
  }

  // Calls that gRPC has not forgotten hand their end over to the context, so the channel goes first.
  asio::io_context context_;
  RpcChannel channel_;
  SessionShared shared_;
  std::unique_ptr<TlsContext> tls_;
  Tcp::acceptor acceptor_;
  int port_ = 0;
  uint64_t next_session_ = 0;  // of the accepting coroutine
  std::mutex mutex_;
  std::condition_variable none_left_;
  std::map<uint64_t, std::shared_ptr<Session>> sessions_;  // guarded by mutex_
  std::optional<asio::executor_work_guard<asio::io_context::executor_type>> work_{context_.get_executor()};
  std::vector<std::jthread> threads_;  // last: they use all of the above
};

absl::StatusOr<std::unique_ptr<HttpServer>> HttpServer::Start(const HttpServerOptions& options,
                                                              std::shared_ptr<grpc::Channel> channel) {
  return Start(options, std::move(channel), nullptr);
}

absl::StatusOr<std::unique_ptr<HttpServer>> HttpServer::Start(const HttpServerOptions& options,
                                                              std::shared_ptr<grpc::Channel> channel,
                                                              const AddRoutes& add_routes) {
  RETURN_IF_ERROR(options.Validate());
  auto impl = std::make_unique<Impl>(options, std::move(channel));
  RETURN_IF_ERROR(impl->Start(add_routes));
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port(); }

void HttpServer::Drain() { impl_->Drain(); }

void HttpServer::Stop(absl::Duration patience) { impl_->Stop(patience); }

}  // namespace depthtween::server
