// One HTTP request and its answer, as route handlers see them: without sockets, so that tests can make their own.
//
// A handler is a coroutine that ends the exchange in one of two ways:
//   Respond                         an answer that is there as a whole
//   StartBody Write* End            an answer that is made piece by piece
// What the handler leaves of the request's body is skipped. A handler that returns without an answer, or throws, is
// answered 500; one that returns in the middle of a body closes the connection, so that the client sees that it is cut.
//
// Threads: an exchange lives on one executor (a strand); the handler runs there, and all calls must come from there.
#ifndef DEPTHTWEEN_SERVER_HTTP_EXCHANGE_H_
#define DEPTHTWEEN_SERVER_HTTP_EXCHANGE_H_

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/awaitable.hpp>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/status.h"

namespace depthtween::server {

// Name and value, in the order sent. Names compare without regard to case.
using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

struct HttpRequest {
  std::string method;                 // such as "GET"
  std::string path;                   // percent-decoded, "/v1/jobs/1:cancel"
  std::vector<std::string> segments;  // of the path: "v1", "jobs", "1:cancel"; none is "", "." or ".."
  std::vector<std::pair<std::string, std::string>> query;  // percent-decoded, in the order sent
  HttpHeaders headers;
  std::map<std::string, std::string> path_values;  // of the route's template: "name" -> "jobs/1"
  std::optional<uint64_t> content_length;          // of the body; nullopt if it comes in chunks. 0 without a body
  std::string peer;                                // "127.0.0.1:4711", "[::1]:4711"
  std::string request_id;                          // the client's x-request-id if it is acceptable, else a new one
  std::string traceparent;                         // of this request, in the client's trace or in one of its own

  // The value of a header, trimmed; of one that is repeated, all values joined by ", ". nullopt without.
  std::optional<std::string> Header(std::string_view name) const;
  // The first value of a query parameter.
  std::optional<std::string> Query(std::string_view name) const;
};

struct HttpResponse {
  int status = 200;
  HttpHeaders headers;
  std::string body;
};

class Exchange {
 public:
  virtual ~Exchange() = default;

  HttpRequest& request() { return request_; }
  const HttpRequest& request() const { return request_; }
  virtual boost::asio::any_io_executor executor() = 0;

  // ---- the request's body ----
  // Up to `size` bytes into `data`; 0 at the end of the body. InvalidArgument: the body is malformed.
  // DeadlineExceeded: it came too slowly. Cancelled: the client is gone. After an error answer and return.
  virtual boost::asio::awaitable<absl::StatusOr<size_t>> ReadSome(char* data, size_t size) = 0;
  // All that is left of it. ResourceExhausted: more than `max_bytes`; else as above.
  boost::asio::awaitable<absl::StatusOr<std::string>> ReadBody(size_t max_bytes);

  // ---- the answer ----
  // Content-Length, Date, x-request-id and what CORS wants are added. To HEAD, bodies are left out.
  // Cancelled: the client is gone.
  virtual boost::asio::awaitable<absl::Status> Respond(HttpResponse response) = 0;
  // Without `content_length` the body is sent in chunks. Not to be followed by more or less than what was announced.
  virtual boost::asio::awaitable<absl::Status> StartBody(int status, HttpHeaders headers,
                                                         std::optional<uint64_t> content_length) = 0;
  // Returns when the bytes are with the operating system: a slow reader slows its handler. Cancelled: the client is
  // gone, or reads nothing for too long.
  virtual boost::asio::awaitable<absl::Status> Write(std::string_view bytes) = 0;
  virtual boost::asio::awaitable<absl::Status> End() = 0;
  // Whether Respond or StartBody was called: an error can then only cut the body.
  virtual bool answered() const = 0;

  // ---- a client that goes away ----
  bool gone() const { return gone_; }
  // Calls `callback` once, on the executor, when the client goes away before the exchange has ended; at once if it is
  // gone. It is forgotten when the result is destroyed, which must not outlive the exchange.
  class GoneWatch;
  [[nodiscard]] std::unique_ptr<GoneWatch> WhenGone(std::function<void()> callback);

 protected:
  explicit Exchange(HttpRequest request) : request_(std::move(request)) {}
  // The client is gone, or the server ends the exchange.
  void MarkGone();

 private:
  HttpRequest request_;
  bool gone_ = false;
  std::list<std::function<void()>> watches_;
};

class Exchange::GoneWatch {
 public:
  GoneWatch(Exchange& exchange, std::list<std::function<void()>>::iterator place)
      : exchange_(exchange), place_(place) {}
  ~GoneWatch() { exchange_.watches_.erase(place_); }
  GoneWatch(const GoneWatch&) = delete;
  GoneWatch& operator=(const GoneWatch&) = delete;

 private:
  Exchange& exchange_;
  const std::list<std::function<void()>>::iterator place_;
};

// Handlers are kept by the router and called concurrently for different exchanges.
using HttpHandler = std::function<boost::asio::awaitable<void>(Exchange&)>;

// Whether two header names are the same.
bool SameHeader(std::string_view left, std::string_view right);

}  // namespace depthtween::server

// RETURN_IF_ERROR and ASSIGN_OR_RETURN for coroutines.
#define CO_RETURN_IF_ERROR(expression)                                         \
  do {                                                                         \
    if (absl::Status status_ = (expression); !status_.ok()) co_return status_; \
  } while (false)
#define CO_ASSIGN_OR_RETURN(declaration, expression) \
  CO_ASSIGN_OR_RETURN_IMPL(DEPTHTWEEN_CONCAT(status_or_, __LINE__), declaration, expression)
#define CO_ASSIGN_OR_RETURN_IMPL(temporary, declaration, expression) \
  auto temporary = (expression);                                     \
  if (!temporary.ok()) co_return std::move(temporary).status();      \
  declaration = *std::move(temporary)

#endif  // DEPTHTWEEN_SERVER_HTTP_EXCHANGE_H_
