#include "server/http/session.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/http/buffer_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <exception>
#include <new>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "server/http/cors.h"
#include "server/http/errors.h"
#include "server/http/head.h"
#include "server/http/target.h"
#include "server/telemetry/log.h"
#include "server/telemetry/metrics.h"
#include "server/telemetry/request_id.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;
namespace beast_http = boost::beast::http;

using Parser = beast_http::request_parser<beast_http::buffer_body>;

constexpr size_t kReadHeadBytes = 4 << 10;
constexpr size_t kReadBytes = 64 << 10;  // of a body
// A line of a chunked body, or its trailers, that is longer than this is no honest one.
constexpr size_t kMaxUnparsedBytes = 16 << 10;
// What is left of a body is read and dropped up to this, to keep the connection for the next request.
constexpr uint64_t kMaxDroppedBytes = 64 << 10;
constexpr size_t kMaxMethodBytes = 32;
constexpr size_t kMaxLoggedPathBytes = 200;
// Of reading what the client still sends, so that it gets the answer before the connection goes.
constexpr absl::Duration kGoodbye = absl::Seconds(2);

std::string HttpDate() { return absl::FormatTime("%a, %d %b %Y %H:%M:%S GMT", absl::Now(), absl::UTCTimeZone()); }

// A value that handlers took from elsewhere must not end its line.
std::string OneLine(std::string value) {
  std::replace_if(
      value.begin(), value.end(), [](unsigned char c) { return c < ' ' || c == 127; }, ' ');
  return value;
}

bool HasBody(int status) { return status >= 200 && status != 204 && status != 304; }

LogLevel LevelOfStatus(int status) {
  if (status >= 500 && status != 503 && status != 501 && status != 504) return LogLevel::kError;
  return status >= 400 && status != 499 ? LogLevel::kInfo : LogLevel::kDebug;
}

// A client may call its method what it likes; a metric must not have a series for each.
std::string_view CountedMethod(std::string_view method) {
  for (const char* known : {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"}) {
    if (method == known) return known;
  }
  return "other";
}

}  // namespace

// ---- one request ----

class Session::Request : public Exchange {
 public:
  Request(Session& session, std::unique_ptr<Parser> parser, HttpRequest request)
      : Exchange(std::move(request)),
        session_(session),
        parser_(std::move(parser)),
        version_(static_cast<int>(parser_->get().version())),
        keep_alive_(parser_->get().keep_alive() && version_ >= 11),
        expects_continue_(version_ >= 11 && !parser_->is_done() && this->request().Header("Expect").has_value()),
        watch_(session.transport_->executor()) {}
  ~Request() override { EndWatch(); }

  asio::any_io_executor executor() override { return session_.transport_->executor(); }
  bool answered() const override { return status_ != 0; }
  int status() const { return status_; }
  bool ended() const { return ended_; }
  bool keep_alive() const { return keep_alive_; }
  using Exchange::MarkGone;

  // Asks now and then whether the client is still there.
  void StartWatch() {
    watch_.expires_after(absl::ToChronoNanoseconds(session_.shared_.options.gone_check));
    watch_.async_wait([this, alive = std::weak_ptr<int>(alive_)](boost::system::error_code error) {
      if (error || alive.expired()) return;
      if (session_.transport_->PeerIsGone()) return MarkGone();
      StartWatch();
    });
  }
  void EndWatch() {
    alive_.reset();
    watch_.cancel();
  }

  asio::awaitable<absl::StatusOr<size_t>> ReadSome(char* data, size_t size) override {
    if (gone()) co_return absl::CancelledError("the client is gone");
    if (expects_continue_) {
      expects_continue_ = false;
      CO_RETURN_IF_ERROR(co_await Send("HTTP/1.1 100 Continue\r\n\r\n"));
    }
    auto& body = parser_->get().body();
    body.data = data;
    body.size = size;
    std::string& buffer = session_.buffer_;
    while (body.size == size && size > 0 && !parser_->is_done()) {
      boost::system::error_code error;
      const size_t used = buffer.empty() ? 0 : parser_->put(asio::const_buffer(buffer.data(), buffer.size()), error);
      buffer.erase(0, used);
      if (error && error != beast_http::error::need_more && error != beast_http::error::need_buffer) {
        keep_alive_ = false;
        co_return absl::InvalidArgumentError(absl::StrCat("the request's body is malformed: ", error.message()));
      }
      if (body.size < size || parser_->is_done()) break;
      if (used > 0 && !buffer.empty()) continue;
      if (buffer.size() > kMaxUnparsedBytes) {
        keep_alive_ = false;
        co_return absl::InvalidArgumentError("the request's body has a chunk head or trailers that are too long");
      }
      const absl::Status filled =
          co_await session_.Fill(kReadBytes, absl::Now() + session_.shared_.options.body_timeout);
      if (!filled.ok()) {
        keep_alive_ = false;
        if (absl::IsCancelled(filled)) MarkGone();
        co_return filled;
      }
    }
    received_ += size - body.size;
    co_return size - body.size;
  }

  asio::awaitable<absl::Status> Respond(HttpResponse response) override {
    const bool has_body = HasBody(response.status);
    std::optional<uint64_t> length;
    if (has_body) length = response.body.size();
    const std::string head = Head(response.status, response.headers, length);
    ended_ = true;
    if (!has_body || request().method == "HEAD") response.body.clear();
    co_return co_await Send(head, response.body);
  }

  asio::awaitable<absl::Status> StartBody(int status, HttpHeaders headers,
                                          std::optional<uint64_t> content_length) override {
    chunked_ = !content_length && version_ >= 11;
    remaining_ = content_length;
    if (!content_length && !chunked_) keep_alive_ = false;  // HTTP/1.0: the end of the connection ends the body
    const std::string head = Head(status, headers, content_length);
    co_return co_await Send(head);
  }

  asio::awaitable<absl::Status> Write(std::string_view bytes) override {
    if (gone()) co_return absl::CancelledError("the client is gone");
    if (remaining_) {
      if (bytes.size() > *remaining_) {
        keep_alive_ = false;
        co_return absl::InternalError("an answer is longer than it was announced");
      }
      *remaining_ -= bytes.size();
    }
    if (bytes.empty() || request().method == "HEAD") co_return absl::OkStatus();
    if (!chunked_) co_return co_await Send(bytes);
    const std::string head = absl::StrFormat("%x\r\n", bytes.size());
    co_return co_await Send(head, bytes, "\r\n");
  }

  asio::awaitable<absl::Status> End() override {
    if (remaining_.value_or(0) != 0 && request().method != "HEAD") {
      keep_alive_ = false;
      co_return absl::InternalError("an answer is shorter than it was announced");
    }
    ended_ = true;
    if (!chunked_ || request().method == "HEAD") co_return gone() ? absl::CancelledError("gone") : absl::OkStatus();
    co_return co_await Send("0\r\n\r\n");
  }

  // Reads and drops the rest of the body. false: it is too much, or broken.
  asio::awaitable<bool> DropBody() {
    std::string dropped(16384, '\0');
    uint64_t count = 0;
    while (!parser_->is_done()) {
      const absl::StatusOr<size_t> read = co_await ReadSome(dropped.data(), dropped.size());
      if (!read.ok() || (count += *read) > kMaxDroppedBytes) co_return false;
    }
    co_return true;
  }

 private:
  // The status line and all headers. Decides whether the connection is kept.
  std::string Head(int status, const HttpHeaders& headers, std::optional<uint64_t> content_length) {
    status_ = status;
    const bool much_left = !parser_->is_done() && (expects_continue_ || !request().content_length ||
                                                   *request().content_length - received_ > kMaxDroppedBytes);
    if (much_left || session_.shared_.draining || status == 408) keep_alive_ = false;
    std::string head = absl::StrCat("HTTP/1.1 ", status, " ", std::string(HttpReason(status)), "\r\nDate: ", HttpDate(),
                                    "\r\n", kRequestIdKey, ": ", request().request_id, "\r\n", kTraceparentKey, ": ",
                                    request().traceparent, "\r\nX-Content-Type-Options: nosniff\r\n");
    const auto add = [&head](const std::string& name, const std::string& value) {
      absl::StrAppend(&head, name, ": ", OneLine(value), "\r\n");
    };
    for (const auto& [name, value] : headers) add(name, value);
    for (const auto& [name, value] : CorsHeaders(session_.shared_.options.allowed_origins, request())) add(name, value);
    const bool says_cache = std::any_of(headers.begin(), headers.end(),
                                        [](const auto& header) { return SameHeader(header.first, "Cache-Control"); });
    if (!says_cache) add("Cache-Control", "no-store");  // most answers are somebody's own
    if (content_length) add("Content-Length", absl::StrCat(*content_length));
    if (!content_length && chunked_) add("Transfer-Encoding", "chunked");
    add("Connection", keep_alive_ ? "keep-alive" : "close");
    absl::StrAppend(&head, "\r\n");
    return head;
  }

  asio::awaitable<absl::Status> Send(std::string_view first, std::string_view second = "",
                                     std::string_view third = "") {
    std::vector<std::string_view> pieces = {first, second, third};
    if (gone()) co_return absl::CancelledError("the client is gone");
    absl::Status sent = co_await session_.transport_->Write(std::move(pieces), session_.shared_.options.write_timeout);
    if (!sent.ok()) {
      keep_alive_ = false;
      MarkGone();
      co_return absl::CancelledError(sent.message());
    }
    co_return sent;
  }

  Session& session_;
  const std::unique_ptr<Parser> parser_;
  const int version_;
  bool keep_alive_;
  bool expects_continue_;
  uint64_t received_ = 0;
  int status_ = 0;
  bool chunked_ = false;
  bool ended_ = false;
  std::optional<uint64_t> remaining_;
  asio::steady_timer watch_;
  std::shared_ptr<int> alive_ = std::make_shared<int>(0);
};

// ---- the connection ----

Session::Session(SessionShared& shared, std::unique_ptr<Transport> transport, std::string peer)
    : shared_(shared), transport_(std::move(transport)), peer_(std::move(peer)) {}

Session::~Session() = default;

asio::awaitable<void> Session::Run(std::shared_ptr<Session> session) {
  const absl::Status secure =
      co_await session->transport_->Handshake(absl::Now() + session->shared_.options.handshake_timeout);
  if (!secure.ok()) {
    Log(LogLevel::kDebug, "http_handshake", {{"peer", session->peer_}, {"why", std::string(secure.message())}});
    co_return;
  }
  bool more = true;
  while (more && !session->shared_.draining) more = co_await session->ServeOne();
  co_await session->transport_->ShutDown(absl::Now() + kGoodbye);
}

void Session::Drain() {
  asio::post(transport_->executor(), [self = shared_from_this()] {
    if (self->idle_) self->transport_->Close();
  });
}

void Session::Cut() {
  asio::post(transport_->executor(), [self = shared_from_this()] {
    if (self->current_ != nullptr) self->current_->MarkGone();
    self->transport_->Close();
  });
}

// Appends at least one byte to buffer_.
asio::awaitable<absl::Status> Session::Fill(size_t bytes, absl::Time deadline) {
  const size_t before = buffer_.size();
  buffer_.resize(before + bytes);
  const absl::StatusOr<size_t> count = co_await transport_->ReadSome(buffer_.data() + before, bytes, deadline);
  buffer_.resize(before + count.value_or(0));
  if (!count.ok()) co_return count.status();
  co_return *count == 0 ? absl::CancelledError("the client is gone") : absl::OkStatus();
}

// Until buffer_ begins with a whole head, whose size is returned. Cancelled: the client went, or sent nothing for long.
asio::awaitable<absl::StatusOr<size_t>> Session::ReadHead() {
  if (buffer_.empty()) {
    std::string().swap(buffer_);  // an idle connection holds no more than it must
    idle_ = true;
    const absl::Status begun = co_await Fill(kReadHeadBytes, absl::Now() + shared_.options.idle_timeout);
    idle_ = false;
    if (!begun.ok()) co_return absl::CancelledError("the client sends no further request");
  }
  const absl::Time deadline = absl::Now() + shared_.options.head_timeout;
  size_t line = 0;
  while (true) {
    for (size_t end = buffer_.find('\n', line); end != std::string::npos; end = buffer_.find('\n', line)) {
      if (end == 0 || buffer_[end - 1] != '\r') {
        co_return absl::InvalidArgumentError("a line of the request's head does not end in CR LF");
      }
      if (line == 0 && end > shared_.options.max_target_bytes) co_return absl::OutOfRangeError("");
      if (end - line == 1) co_return end + 1;
      line = end + 1;
    }
    if (line == 0 && buffer_.size() > shared_.options.max_target_bytes) co_return absl::OutOfRangeError("");
    if (buffer_.size() > shared_.options.max_head_bytes) co_return absl::ResourceExhaustedError("");
    CO_RETURN_IF_ERROR(co_await Fill(kReadHeadBytes, deadline));
  }
}

// Answers a request that cannot be read; the connection ends with it.
asio::awaitable<void> Session::Refuse(int http_status, absl::Status status) {
  const HttpResponse response = ErrorResponse(http_status, status);
  const std::string head =
      absl::StrCat("HTTP/1.1 ", http_status, " ", std::string(HttpReason(http_status)), "\r\nDate: ", HttpDate(),
                   "\r\nContent-Type: application/json\r\nX-Content-Type-Options: nosniff\r\nCache-Control: "
                   "no-store\r\nContent-Length: ",
                   response.body.size(), "\r\nConnection: close\r\n\r\n");
  CountHttpRequest(CountedMethod(""), http_status);
  Log(LevelOfStatus(http_status), "http",
      {{"status", absl::StrCat(http_status)}, {"peer", peer_}, {"detail", std::string(status.message())}});
  std::vector<std::string_view> pieces = {head, response.body};
  (void)co_await transport_->Write(std::move(pieces), shared_.options.write_timeout);
}

// One request. false: the connection ends.
asio::awaitable<bool> Session::ServeOne() {
  const HttpServerOptions& options = shared_.options;
  const absl::StatusOr<size_t> head = co_await ReadHead();
  if (!head.ok()) {
    switch (head.status().code()) {
      case absl::StatusCode::kInvalidArgument:
        co_await Refuse(400, head.status());
        break;
      case absl::StatusCode::kDeadlineExceeded:
        break;  // the connection is closed already: who sends a head this slowly waits for no answer
      case absl::StatusCode::kOutOfRange:
        co_await Refuse(414, absl::InvalidArgumentError(absl::StrFormat(
                                 "the request's first line is longer than %d bytes", options.max_target_bytes)));
        break;
      case absl::StatusCode::kResourceExhausted:
        co_await Refuse(431, absl::ResourceExhaustedError(absl::StrFormat("the request's head is larger than %d bytes",
                                                                          options.max_head_bytes)));
        break;
      default:
        break;
    }
    co_return false;
  }
  if (*head > options.max_head_bytes) {
    co_await Refuse(431, absl::ResourceExhaustedError(
                             absl::StrFormat("the request's head is larger than %d bytes", options.max_head_bytes)));
    co_return false;
  }
  const absl::Status plain = CheckHeadBytes(std::string_view(buffer_).substr(0, *head), options.max_headers);
  if (!plain.ok()) {
    co_await Refuse(absl::IsResourceExhausted(plain) ? 431 : 400, plain);
    co_return false;
  }

  auto parser = std::make_unique<Parser>();
  parser->header_limit(static_cast<uint32_t>(options.max_head_bytes) + 1);
  parser->body_limit(boost::none);  // each handler has its own
  boost::system::error_code error;
  const size_t used = parser->put(asio::const_buffer(buffer_.data(), *head), error);
  if (!parser->is_header_done()) {
    const bool version = error == beast_http::error::bad_version;
    co_await Refuse(version ? 505 : 400,
                    absl::InvalidArgumentError(absl::StrCat("the request's head is malformed: ", error.message())));
    co_return false;
  }
  buffer_.erase(0, used);
  parser->eager(true);

  const auto& message = parser->get();
  HttpRequest request;
  request.method = std::string(message.method_string().data(), message.method_string().size());
  for (const auto& field : message) {
    request.headers.emplace_back(std::string(field.name_string().data(), field.name_string().size()),
                                 std::string(field.value().data(), field.value().size()));
  }
  const std::string target(message.target().data(), message.target().size());
  absl::Status wrong = CheckHeaders(static_cast<int>(message.version()), request.headers);
  absl::StatusOr<RequestTarget> parsed = ParseTarget(target);
  if (wrong.ok() && !parsed.ok()) wrong = parsed.status();
  if (wrong.ok() && request.method.size() > kMaxMethodBytes) wrong = absl::UnimplementedError("no such method");
  if (!wrong.ok()) {
    co_await Refuse(HttpStatusOf(static_cast<int>(wrong.code())), wrong);
    co_return false;
  }
  request.path = std::move(parsed->path);
  request.segments = std::move(parsed->segments);
  request.query = std::move(parsed->query);
  if (parser->is_done()) {
    request.content_length = 0;
  } else if (const auto length = parser->content_length()) {
    request.content_length = *length;
  }
  request.peer = peer_;
  request.request_id = ChooseRequestId(request.Header(kRequestIdKey).value_or(""));
  request.traceparent = ContinueTrace(request.Header(kTraceparentKey).value_or(""));

  const absl::Time start = absl::Now();
  const bool health = request.path == "/healthz";
  std::optional<Router::Found> found = shared_.router.Find(request.method, request.segments);
  // A preflight asks about the request to come, also on paths where OPTIONS has an answer of its own.
  if (request.method == "OPTIONS" && request.Header("Access-Control-Request-Method")) found.reset();
  if (found) request.path_values = std::move(found->path_values);
  Request exchange(*this, std::move(parser), std::move(request));
  current_ = &exchange;
  exchange.StartWatch();
  const int in_flight = ++shared_.requests;
  std::string failure;
  if (in_flight > options.max_requests && !health) {
    HttpResponse busy = ErrorResponse(
        503, absl::ResourceExhaustedError(absl::StrFormat(
                 "%d requests are being answered, which is the limit; try again later", options.max_requests)));
    busy.headers.emplace_back("Retry-After", "1");
    (void)co_await exchange.Respond(std::move(busy));
  } else if (!IsAllowedHost(options.allowed_hosts, exchange.request())) {
    HttpResponse refused = ErrorResponse(absl::PermissionDeniedError(
        "this server does not answer under this Host, so that no web page can lead a browser here; the operator allows "
        "names by --allow-host"));
    (void)co_await exchange.Respond(std::move(refused));
  } else if (IsCrossSiteWrite(options.allowed_origins, exchange.request())) {
    HttpResponse refused = ErrorResponse(absl::PermissionDeniedError(
        "pages of this origin may not change anything here; the operator allows origins by --allow-origin"));
    (void)co_await exchange.Respond(std::move(refused));
  } else if (found) {
    try {
      co_await (*found->handler)(exchange);
    } catch (const std::bad_alloc&) {
      failure = "the server is out of memory for this request; try again later";
    } catch (const std::exception& exception) {
      failure = absl::StrCat("unexpected failure, please report it: ", exception.what());
    }
    if (failure.empty() && !exchange.answered()) failure = "the request was left without an answer, please report it";
  } else {
    const std::vector<std::string> methods = shared_.router.Methods(exchange.request().segments);
    const std::string& method = exchange.request().method;
    HttpResponse response;
    if (auto preflight =
            methods.empty() ? std::nullopt : PreflightResponse(options.allowed_origins, exchange.request(), methods)) {
      response = *std::move(preflight);
    } else if (method == "OPTIONS" && (!methods.empty() || exchange.request().path == "*")) {
      response.status = 204;
    } else if (methods.empty()) {
      response = ErrorResponse(absl::NotFoundError("there is nothing at this path; /openapi.json lists what there is"));
    } else {
      response = ErrorResponse(405, absl::UnimplementedError(absl::StrFormat("this path has no %s, only %s", method,
                                                                             absl::StrJoin(methods, ", "))));
    }
    if (!methods.empty()) response.headers.emplace_back("Allow", absl::StrJoin(methods, ", "));
    (void)co_await exchange.Respond(std::move(response));
  }
  if (!failure.empty() && !exchange.answered() && !exchange.gone()) {
    (void)co_await exchange.Respond(ErrorResponse(absl::InternalError(failure)));
  }
  --shared_.requests;
  exchange.EndWatch();
  const int status = exchange.answered() ? exchange.status() : 499;
  CountHttpRequest(CountedMethod(exchange.request().method), status);
  Log(LevelOfStatus(status), "http",
      {{"method", exchange.request().method},
       {"path", exchange.request().path.substr(0, kMaxLoggedPathBytes)},
       {"status", absl::StrCat(status)},
       {"ms", absl::StrFormat("%.1f", absl::ToDoubleMilliseconds(absl::Now() - start))},
       {"request", exchange.request().request_id},
       {"trace", TraceOf(exchange.request().traceparent)},
       {"peer", peer_},
       {"detail", failure.empty() && exchange.gone() ? "the client is gone" : failure}});
  // A body that is cut must not look whole.
  bool keep = exchange.answered() && exchange.ended() && exchange.keep_alive() && !exchange.gone();
  if (exchange.answered() && !exchange.ended()) transport_->Close();
  if (keep) keep = co_await exchange.DropBody();
  current_ = nullptr;
  co_return keep;
}

}  // namespace depthtween::server
