// The listener over real sockets, with handlers of its own: RFC 9110 and 9112 where requests are good, and a clear
// answer or a closed connection, never a silent server, where they are hostile.
#include "server/http/http_server.h"

#include <gmock/gmock.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <atomic>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <nlohmann/json.hpp>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "server/http/errors.h"
#include "server/http/router.h"
#include "tests/server/http/raw_client.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;
using testing::HasSubstr;
using testing::StartsWith;

// Handlers whose behaviour is known: what a real one makes of the request is not what is tested here.
class HttpServerTest : public testing::Test {
 protected:
  HttpServerOptions options = {
      .listen = "127.0.0.1:0", .threads = 2, .body_timeout = absl::Seconds(20), .gone_check = absl::Milliseconds(20)};

  HttpServer& server() {
    if (server_ == nullptr) {
      // Nobody is there: these handlers make no calls.
      auto channel = grpc::CreateChannel("unix:/nonexistent", grpc::InsecureChannelCredentials());
      auto started =
          HttpServer::Start(options, std::move(channel), [this](Router& router, RpcChannel&) { Add(router); });
      EXPECT_TRUE(started.ok()) << started.status();
      server_ = *std::move(started);
    }
    return *server_;
  }
  int port() { return server().port(); }
  // Whatever came before.
  void ExpectServing() { EXPECT_EQ(GetOnce(port(), "/healthz").status, 200); }

  std::atomic<int> gone = 0;
  std::atomic<bool> waiting = false;
  std::atomic<bool> cut = false;

 private:
  void Add(Router& router) {
    router.Add("POST", "/echo", [](Exchange& exchange) -> asio::awaitable<void> {
      absl::StatusOr<std::string> body = co_await exchange.ReadBody(100'000);
      HttpResponse response = body.ok() ? HttpResponse{.body = *std::move(body)} : ErrorResponse(body.status());
      (void)co_await exchange.Respond(std::move(response));
    });
    router.Add("POST", "/ignore", [](Exchange& exchange) -> asio::awaitable<void> {
      HttpResponse response{.body = "ignored"};
      (void)co_await exchange.Respond(std::move(response));
    });
    router.Add("GET", "/pieces", [](Exchange& exchange) -> asio::awaitable<void> {
      HttpHeaders headers = {{"X-Split", "a\r\nb: c"}};
      (void)co_await exchange.StartBody(200, std::move(headers), std::nullopt);
      for (const char* piece : {"one,", "", "two"}) (void)co_await exchange.Write(piece);
      (void)co_await exchange.End();
    });
    router.Add("GET", "/short", [](Exchange& exchange) -> asio::awaitable<void> {
      HttpHeaders headers;
      (void)co_await exchange.StartBody(200, std::move(headers), 10);
      (void)co_await exchange.Write("four");
      (void)co_await exchange.End();
    });
    router.Add("GET", "/throw", [](Exchange&) -> asio::awaitable<void> {
      throw std::runtime_error("deliberate");
      co_return;
    });
    router.Add("GET", "/wait", [this](Exchange& exchange) -> asio::awaitable<void> {
      asio::steady_timer timer(exchange.executor(), asio::steady_timer::time_point::max());
      const auto watch = exchange.WhenGone([&timer, this] {
        ++gone;
        timer.cancel();
      });
      waiting = true;
      try {
        co_await timer.async_wait(asio::use_awaitable);
      } catch (const std::exception&) {
        co_return;
      }
    });
    router.Add("GET", "/endless", [this](Exchange& exchange) -> asio::awaitable<void> {
      HttpHeaders headers;
      absl::Status written = co_await exchange.StartBody(200, std::move(headers), std::nullopt);
      const std::string piece(100'000, 'x');
      while (written.ok()) written = co_await exchange.Write(piece);
      cut = true;
    });
  }

  std::unique_ptr<HttpServer> server_;
};

TEST_F(HttpServerTest, KeepsTheConnection) {
  RawClient client(port());
  for (int i = 0; i < 3; ++i) {
    client.Post("/echo", absl::StrCat("body ", i));
    const RawAnswer answer = client.ReadAnswer();
    EXPECT_EQ(answer.status, 200);
    EXPECT_EQ(answer.body, absl::StrCat("body ", i));
    EXPECT_EQ(answer.Header("Connection"), "keep-alive");
    EXPECT_EQ(answer.Header("X-Content-Type-Options"), "nosniff");
    EXPECT_FALSE(answer.Header("x-request-id").empty());
  }
  // All at once, in the order asked.
  client.Send("GET /healthz HTTP/1.1\r\nHost: a\r\n\r\nGET /pieces HTTP/1.1\r\nHost: a\r\n\r\n");
  EXPECT_THAT(client.ReadAnswer().body, HasSubstr("UP"));
  EXPECT_EQ(client.ReadAnswer().body, "one,two");
  client.Get("/healthz", "Connection: close\r\n");
  EXPECT_EQ(client.ReadAnswer().Header("Connection"), "close");
  EXPECT_EQ(client.ReadToEnd(), "");
}

TEST_F(HttpServerTest, ChunkedBothWays) {
  RawClient client(port());
  client.Send(
      "POST /echo HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: "
      "chunked\r\n\r\n3\r\nabc\r\nA;x=y\r\n0123456789\r\n0\r\n\r\n");
  EXPECT_EQ(client.ReadAnswer().body, "abc0123456789");
  client.Get("/pieces");
  const RawAnswer answer = client.ReadAnswer();
  EXPECT_EQ(answer.body, "one,two");
  EXPECT_EQ(answer.Header("Transfer-Encoding"), "chunked");
  EXPECT_EQ(answer.Header("X-Split"), "a  b: c");  // no header can be smuggled into an answer
}

// RFC 9110, 9.3.2: HEAD answers as GET does, without the body.
TEST_F(HttpServerTest, HeadAndOptions) {
  RawClient client(port());
  client.Send("HEAD /healthz HTTP/1.1\r\nHost: a\r\n\r\n");
  const RawAnswer head = client.ReadAnswer(/*to_head=*/true);
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.Header("Content-Length"), absl::StrCat(GetOnce(port(), "/healthz").body.size()));
  client.Send("OPTIONS /echo HTTP/1.1\r\nHost: a\r\n\r\n");
  const RawAnswer options_answer = client.ReadAnswer();
  EXPECT_EQ(options_answer.status, 204);
  EXPECT_EQ(options_answer.Header("Allow"), "OPTIONS, POST");
  client.Send("OPTIONS * HTTP/1.1\r\nHost: a\r\n\r\n");
  EXPECT_EQ(client.ReadAnswer().status, 204);
}

TEST_F(HttpServerTest, NothingThereAndWrongMethod) {
  const RawAnswer missing = GetOnce(port(), "/nothing?signature=secret");
  EXPECT_EQ(missing.status, 404);
  EXPECT_EQ(nlohmann::json::parse(missing.body)["code"], 5);
  EXPECT_THAT(missing.body, testing::Not(HasSubstr("secret")));
  const RawAnswer wrong = GetOnce(port(), "/echo");
  EXPECT_EQ(wrong.status, 405);
  EXPECT_EQ(wrong.Header("Allow"), "OPTIONS, POST");
}

// What must not look whole does not: the connection ends in the middle of it.
TEST_F(HttpServerTest, FailingHandlersAreSeen) {
  EXPECT_EQ(GetOnce(port(), "/throw").status, 500);
  EXPECT_EQ(GetOnce(port(), "/short").status, 0);
  ExpectServing();
}

TEST_F(HttpServerTest, ExpectContinue) {
  RawClient client(port());
  client.Send("POST /echo HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_THAT(*client.ReadLine(), StartsWith("HTTP/1.1 100"));
  client.ReadLine();
  client.Send("hello");
  EXPECT_EQ(client.ReadAnswer().body, "hello");
  // An answer without the body: the server cannot know whether it comes, and ends the connection.
  client.Send("POST /ignore HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_EQ(client.ReadAnswer().Header("Connection"), "close");
  EXPECT_EQ(client.ReadToEnd(), "");
}

// A body that nobody wanted is read over if it is small, so that the connection can be kept, and else ends it.
TEST_F(HttpServerTest, BodiesThatAreNotRead) {
  RawClient client(port());
  client.Post("/ignore", std::string(1000, 'x'));
  EXPECT_EQ(client.ReadAnswer().Header("Connection"), "keep-alive");
  client.Post("/ignore", std::string(200'000, 'x'));
  EXPECT_EQ(client.ReadAnswer().Header("Connection"), "close");
}

TEST_F(HttpServerTest, BoundsBodies) {
  const RawAnswer answer = PostOnce(port(), "/echo", std::string(100'001, 'x'));
  EXPECT_EQ(nlohmann::json::parse(answer.body)["code"], 8);
  ExpectServing();
}

// Each is a way to make two programs in a row see different requests (RFC 9112, 11.2), or to break a parser.
TEST_F(HttpServerTest, RefusesMalformedRequests) {
  const std::string host = "Host: a\r\n";
  const std::vector<std::pair<std::string, int>> requests = {
      {"GET / HTTP/1.1\r\n\r\n", 400},                                          // no Host
      {"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", 400},                    // two
      {"GET / HTTP/1.1\nHost: a\n\n", 400},                                     // bare LF
      {"GET / HTTP/1.1\r\nHost: a\nX: y\r\n\r\n", 400},                         // one bare LF
      {"GET / HTTP/1.1\r\n" + host + "X: a\rb\r\n\r\n", 400},                   // bare CR
      {"GET / HTTP/1.1\r\n" + host + "X: a\r\n b\r\n\r\n", 400},                // obs-fold
      {"GET / HTTP/1.1\r\n" + host + "X : a\r\n\r\n", 400},                     // blank before colon
      {"GET / HTTP/1.1\r\n" + host + "X\r\n\r\n", 400},                         // no colon
      {"GET / HTTP/1.1\r\n" + host + std::string("X: a\0b\r\n\r\n", 10), 400},  // NUL
      {"GET  / HTTP/1.1\r\n" + host + "\r\n", 400},                             // two blanks
      {"GET / HTTP/2.0\r\n" + host + "\r\n", 505},
      {"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", 505},
      {"\r\n\r\n", 400},
      {"GARBAGE\r\n\r\n", 400},
      {"\x16\x03\x01\x02\x01\x01\r\n\r\n", 400},  // TLS without TLS
      {"GET /../etc/passwd HTTP/1.1\r\n" + host + "\r\n", 400},
      {"GET /%2e%2e/x HTTP/1.1\r\n" + host + "\r\n", 400},
      {"GET /a%2fb HTTP/1.1\r\n" + host + "\r\n", 400},
      {"GET /a%00 HTTP/1.1\r\n" + host + "\r\n", 400},
      {"GET /a%5cb HTTP/1.1\r\n" + host + "\r\n", 400},
      {"GET /a%252e HTTP/1.1\r\n" + host + "\r\n", 400},
      {"CONNECT a:80 HTTP/1.1\r\n" + host + "\r\n", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: 3\r\nContent-Length: 3\r\n\r\nabc", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: 3\r\nContent-Length: 4\r\n\r\nabcd", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: 3, 3\r\n\r\nabc", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: +3\r\n\r\nabc", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: -3\r\n\r\nabc", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: 99999999999999999999999\r\n\r\n", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\nContent-Length: 3\r\n\r\n0\r\n\r\n", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n", 501},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: xchunked\r\n\r\n0\r\n\r\n", 501},
      {"POST /echo HTTP/1.0\r\n" + host + "Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\n\r\nzz\r\n", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\n\r\n-1\r\nabc", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\n\r\n3\r\nabcdef\r\n0\r\n\r\n", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFFF\r\nabc", 400},
      {"POST /echo HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\n\r\n3;" + std::string(100'000, 'x'), 400},
      {"GET / HTTP/1.1\r\n" + host + "Expect: the-unexpected\r\n\r\n", 501},
      {"GET /" + std::string(20'000, 'a') + " HTTP/1.1\r\n" + host + "\r\n", 414},
      {"GET / HTTP/1.1\r\n" + host + "X: " + std::string(1 << 20, 'a') + "\r\n\r\n", 431},
  };
  for (const auto& [request, status] : requests) {
    RawClient client(port());
    client.Send(request);
    const RawAnswer answer = client.ReadAnswer();
    EXPECT_EQ(answer.status, status) << request.substr(0, 200);
    EXPECT_EQ(answer.Header("Connection"), "close") << request.substr(0, 200);
    EXPECT_EQ(client.ReadToEnd(), "") << request.substr(0, 200);  // nothing after it is taken for a request
  }
  ExpectServing();
}

TEST_F(HttpServerTest, BoundsHeaders) {
  for (const int count : {101, 10'000}) {
    std::string request = "GET /healthz HTTP/1.1\r\nHost: a\r\n";
    for (int i = 1; i < count; ++i) absl::StrAppend(&request, "X", i, ": y\r\n");
    RawClient client(port());
    client.Send(request + "\r\n");
    EXPECT_EQ(client.ReadAnswer().status, 431) << count;
  }
  ExpectServing();
}

// A client that sends a byte now and then, or a part and no more, loses its connection; the limits are absolute.
TEST_F(HttpServerTest, SlowClientsAreCut) {
  options.idle_timeout = absl::Milliseconds(300);
  options.head_timeout = absl::Milliseconds(300);
  options.body_timeout = absl::Milliseconds(300);
  RawClient silent(port()), half_head(port()), half_body(port()), drip(port());
  half_head.Send("GET / HTTP/1.1\r\nHos");
  half_body.Send("POST /echo HTTP/1.1\r\nHost: a\r\nContent-Length: 10\r\n\r\nabc");
  EXPECT_EQ(silent.ReadToEnd(), "");
  EXPECT_EQ(half_head.ReadToEnd(), "");
  EXPECT_THAT(half_body.ReadToEnd(), testing::AnyOf("", StartsWith("HTTP/1.1 504")));
  int sent = 0;
  while (sent < 10'000 && drip.Send("G")) {
    ++sent;
    absl::SleepFor(absl::Milliseconds(10));
  }
  EXPECT_LT(sent, 10'000);
  ExpectServing();
}

// A client that does not read is cut too.
TEST_F(HttpServerTest, ReadersThatStopAreCut) {
  options.write_timeout = absl::Milliseconds(300);
  RawClient reader(port());
  reader.Get("/endless");
  while (!cut) absl::SleepFor(absl::Milliseconds(20));
  ExpectServing();
}

// What is done for a client ends when it goes, whether it says goodbye or not.
TEST_F(HttpServerTest, NoticesThatAClientIsGone) {
  {
    RawClient client(port());
    client.Get("/wait");
    while (!waiting) absl::SleepFor(absl::Milliseconds(5));
  }
  while (gone == 0) absl::SleepFor(absl::Milliseconds(5));
  ExpectServing();
}

TEST_F(HttpServerTest, BoundsConnectionsAndRequests) {
  options.max_connections = 2;
  options.max_requests = 1;
  RawClient waiter(port()), second(port());
  waiter.Get("/wait");
  while (!waiting) absl::SleepFor(absl::Milliseconds(5));
  second.Get("/nothing");
  const RawAnswer busy = second.ReadAnswer();
  EXPECT_EQ(busy.status, 503);
  EXPECT_EQ(busy.Header("Retry-After"), "1");
  second.Get("/healthz");  // whether the process lives must always be answered
  EXPECT_EQ(second.ReadAnswer().status, 200);
  RawClient third(port());
  EXPECT_THAT(third.ReadToEnd(), StartsWith("HTTP/1.1 503"));
}

// Without a file descriptor to spare the server waits, and goes on when there is one.
TEST_F(HttpServerTest, SurvivesLackOfFileDescriptors) {
  ExpectServing();
  rlimit before{};
  getrlimit(RLIMIT_NOFILE, &before);
  const int highest = dup(0);
  close(highest);
  // As many as are open, and one for the client's own socket.
  const rlimit few{.rlim_cur = static_cast<rlim_t>(highest) + 1, .rlim_max = before.rlim_max};
  setrlimit(RLIMIT_NOFILE, &few);
  RawClient client(port());
  client.Get("/healthz");
  absl::SleepFor(absl::Milliseconds(300));
  setrlimit(RLIMIT_NOFILE, &before);
  EXPECT_EQ(client.ReadAnswer().status, 200);
}

TEST_F(HttpServerTest, StopEndsEverything) {
  RawClient idle(port()), waiter(port());
  idle.Get("/healthz");
  EXPECT_EQ(idle.ReadAnswer().status, 200);
  waiter.Get("/wait");
  while (!waiting) absl::SleepFor(absl::Milliseconds(5));
  server().Drain();
  EXPECT_EQ(idle.ReadToEnd(), "");
  EXPECT_EQ(gone, 0);  // what is under way goes on while there is patience
  server().Stop(absl::Milliseconds(10));
  EXPECT_EQ(gone, 1);
  EXPECT_EQ(waiter.ReadToEnd(), "");
}

TEST_F(HttpServerTest, CorsOnlyForAllowedOrigins) {
  options.allowed_origins = {"https://good.example"};
  const RawAnswer good = GetOnce(port(), "/healthz", "Origin: https://good.example\r\n");
  EXPECT_EQ(good.Header("Access-Control-Allow-Origin"), "https://good.example");
  EXPECT_EQ(good.Header("Vary"), "Origin");
  EXPECT_THAT(good.Header("Access-Control-Expose-Headers"), HasSubstr("grpc-status"));
  EXPECT_EQ(GetOnce(port(), "/healthz", "Origin: https://evil.example\r\n").Header("Access-Control-Allow-Origin"), "");

  const auto preflight = [this](const std::string& origin) {
    RawClient client(port());
    client.Send(absl::StrCat("OPTIONS /echo HTTP/1.1\r\nHost: a\r\nOrigin: ", origin,
                             "\r\nAccess-Control-Request-Method: POST\r\n"
                             "Access-Control-Request-Headers: authorization,content-type\r\n\r\n"));
    return client.ReadAnswer();
  };
  const RawAnswer allowed = preflight("https://good.example");
  EXPECT_EQ(allowed.status, 204);
  EXPECT_THAT(allowed.Header("Access-Control-Allow-Methods"), HasSubstr("POST"));
  EXPECT_EQ(allowed.Header("Access-Control-Allow-Headers"), "authorization,content-type");
  EXPECT_EQ(preflight("https://evil.example").status, 403);
}

TEST_F(HttpServerTest, OnlyHostsOfTheListAreAnswered) {
  options.allowed_hosts = {"localhost", "127.0.0.1"};
  const auto status_for = [this](const std::string& host) {
    RawClient client(port());
    client.Send(absl::StrCat("GET /healthz HTTP/1.1\r\nHost: ", host, "\r\n\r\n"));
    return client.ReadAnswer().status;
  };
  EXPECT_EQ(status_for(absl::StrCat("localhost:", port())), 200);
  EXPECT_EQ(status_for("127.0.0.1"), 200);
  EXPECT_EQ(status_for("rebound.example"), 403);
}

// https://www.w3.org/TR/trace-context/
TEST_F(HttpServerTest, ATraceIsContinuedOrBegun) {
  const RawAnswer traced =
      GetOnce(port(), "/healthz", "traceparent: 00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01\r\n");
  EXPECT_THAT(traced.Header("traceparent"),
              testing::MatchesRegex("00-0af7651916cd43dd8448eb211c80319c-[0-9a-f]{16}-01"));
  EXPECT_THAT(GetOnce(port(), "/healthz").Header("traceparent"),
              testing::MatchesRegex("00-[0-9a-f]{32}-[0-9a-f]{16}-00"));
}

TEST(HttpServerOptions, ExplainWhatIsWrong) {
  EXPECT_TRUE(HttpServerOptions().Validate().ok());
  EXPECT_THAT(std::string(HttpServerOptions{.listen = "unix:/x"}.Validate().message()), HasSubstr("HOST:PORT"));
  EXPECT_EQ(HttpServerOptions{.listen = "0.0.0.0:0"}.Validate().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE((HttpServerOptions{.listen = "0.0.0.0:0", .insecure_listen_anywhere = true}).Validate().ok());
  EXPECT_EQ((HttpServerOptions{.tls = {.cert = "/nonexistent", .key = "/nonexistent"}}).Validate().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(HttpServerOptions{.allowed_origins = {"good.example"}}.Validate().message()),
              HasSubstr("https://"));
  EXPECT_THAT(std::string(HttpServerOptions{.threads = 0}.Validate().message()), HasSubstr("threads = 0"));
}

}  // namespace
}  // namespace depthtween::server
