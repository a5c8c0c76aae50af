// Heads of requests against RFC 9112: what it forbids servers to accept, byte for byte.
#include "server/http/head.h"

#include <gtest/gtest.h>

namespace depthtween::server {
namespace {

absl::StatusCode CodeOf(std::string_view head, size_t max_headers = 3) {
  return CheckHeadBytes(head, max_headers).code();
}

TEST(Head, Bytes) {
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA: b\r\nC:\td\r\n\r\n"), absl::StatusCode::kOk);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA: b\nC: d\r\n\r\n"), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA: b\rC: d\r\n\r\n"), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA: b\r\n c\r\n\r\n"), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA: b\r\n\tc\r\n\r\n"), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA : b\r\n\r\n"), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\n: b\r\n\r\n"), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf(std::string_view("GET / HTTP/1.1\r\nA: \0\r\n\r\n", 24)), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA: b\r\nA: b\r\nA: b\r\n\r\n"), absl::StatusCode::kOk);
  EXPECT_EQ(CodeOf("GET / HTTP/1.1\r\nA: b\r\nA: b\r\nA: b\r\nA: b\r\n\r\n"), absl::StatusCode::kResourceExhausted);
}

TEST(Head, Headers) {
  const auto code = [](int version, HttpHeaders headers) { return CheckHeaders(version, headers).code(); };
  EXPECT_EQ(code(11, {{"Host", "a"}}), absl::StatusCode::kOk);
  EXPECT_EQ(code(10, {}), absl::StatusCode::kOk);
  EXPECT_EQ(code(11, {}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"host", "a"}}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Transfer-Encoding", "Chunked"}}), absl::StatusCode::kOk);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Transfer-Encoding", "identity"}}), absl::StatusCode::kUnimplemented);
  EXPECT_EQ(code(10, {{"Transfer-Encoding", "chunked"}}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Content-Length", "1"}, {"Content-Length", "1"}}),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Content-Length", "0x1"}}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Content-Length", ""}}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Content-Length", "1"}, {"Transfer-Encoding", "chunked"}}),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Expect", "100-Continue"}}), absl::StatusCode::kOk);
  EXPECT_EQ(code(11, {{"Host", "a"}, {"Expect", "x"}}), absl::StatusCode::kUnimplemented);
}

}  // namespace
}  // namespace depthtween::server
