// What handlers are promised of a request, on an exchange without a socket.
#include "server/http/exchange.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/http/fake_exchange.h"

namespace depthtween::server {
namespace {

using testing::Optional;

// RFC 9110, 5.1 and 5.2: names without regard to case; a repeated field is a list.
TEST(HttpRequest, HeadersByName) {
  const HttpRequest request{.headers = {{"Accept", "a"}, {"X-One", "1"}, {"accept", "b"}}};
  EXPECT_THAT(request.Header("ACCEPT"), Optional(std::string("a, b")));
  EXPECT_THAT(request.Header("x-one"), Optional(std::string("1")));
  EXPECT_EQ(request.Header("x-two"), std::nullopt);
  EXPECT_TRUE(SameHeader("ETag", "etag"));
  EXPECT_FALSE(SameHeader("ETag", "etags"));
}

TEST(HttpRequest, FirstQueryParameter) {
  const HttpRequest request{.query = {{"a", "1"}, {"a", "2"}, {"b", ""}}};
  EXPECT_THAT(request.Query("a"), Optional(std::string("1")));
  EXPECT_THAT(request.Query("b"), Optional(std::string()));
  EXPECT_EQ(request.Query("c"), std::nullopt);
}

// Whatever the pieces it comes in: whole up to the limit, an error one byte above it.
TEST(Exchange, ReadBodyIsBounded) {
  const std::string bytes(100, 'x');
  for (const size_t piece : {1, 7, 1000}) {
    boost::asio::io_context context;
    FakeExchange whole(context, {}, bytes, piece);
    const auto body = RunToEnd(context, whole.ReadBody(100));
    ASSERT_TRUE(body.ok());
    EXPECT_EQ(*body, bytes);
    FakeExchange larger(context, {}, bytes, piece);
    EXPECT_EQ(RunToEnd(context, larger.ReadBody(99)).status().code(), absl::StatusCode::kResourceExhausted);
  }
}

// Once, whether it registered before or after; not at all once it is forgotten.
TEST(Exchange, TellsThatTheClientIsGone) {
  boost::asio::io_context context;
  FakeExchange exchange(context, {});
  int kept = 0, forgotten = 0, late = 0;
  const auto watch = exchange.WhenGone([&kept] { ++kept; });
  exchange.WhenGone([&forgotten] { ++forgotten; }).reset();
  exchange.MarkGone();
  exchange.MarkGone();
  const auto late_watch = exchange.WhenGone([&late] { ++late; });
  EXPECT_EQ(kept, 1);
  EXPECT_EQ(forgotten, 0);
  EXPECT_EQ(late, 1);
  EXPECT_TRUE(exchange.gone());
}

}  // namespace
}  // namespace depthtween::server
