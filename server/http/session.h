// One connection: its requests one after another, each answered by the router's handler.
#ifndef DEPTHTWEEN_SERVER_HTTP_SESSION_H_
#define DEPTHTWEEN_SERVER_HTTP_SESSION_H_

#include <atomic>
#include <boost/asio/awaitable.hpp>
#include <memory>
#include <string>

#include "server/http/http_server.h"
#include "server/http/router.h"
#include "server/http/transport.h"

namespace depthtween::server {

// What the sessions of a server share. Threads: all of it is safe to use concurrently.
struct SessionShared {
  HttpServerOptions options;
  Router router;
  std::atomic<int> requests = 0;  // in flight
  std::atomic<bool> draining = false;
};

class Session : public std::enable_shared_from_this<Session> {
 public:
  Session(SessionShared& shared, std::unique_ptr<Transport> transport, std::string peer);
  ~Session();

  // Until the connection ends. Keeps the session.
  static boost::asio::awaitable<void> Run(std::shared_ptr<Session> session);

  boost::asio::any_io_executor executor() { return transport_->executor(); }

  // From any thread. Closes the connection if no request is under way; it ends after the one that is.
  void Drain();
  // From any thread. Ends the connection now, and what is done for it.
  void Cut();

 private:
  class Request;

  boost::asio::awaitable<bool> ServeOne();
  boost::asio::awaitable<absl::StatusOr<size_t>> ReadHead();
  boost::asio::awaitable<absl::Status> Fill(size_t bytes, absl::Time deadline);
  boost::asio::awaitable<void> Refuse(int http_status, absl::Status status);

  SessionShared& shared_;
  const std::unique_ptr<Transport> transport_;
  const std::string peer_;
  std::string buffer_;          // read and not yet used
  Request* current_ = nullptr;  // the one under way
  bool idle_ = true;            // no byte of a request has come
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_SESSION_H_
