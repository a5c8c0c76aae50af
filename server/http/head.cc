#include "server/http/head.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"

namespace depthtween::server {
namespace {

int CountHeader(const HttpHeaders& headers, std::string_view name) {
  return static_cast<int>(std::count_if(headers.begin(), headers.end(),
                                        [name](const auto& header) { return SameHeader(header.first, name); }));
}

std::string ValueOf(const HttpHeaders& headers, std::string_view name) {
  for (const auto& [key, value] : headers) {
    if (SameHeader(key, name)) return value;
  }
  return "";
}

}  // namespace

absl::Status CheckHeadBytes(std::string_view head, size_t max_headers) {
  if (head.find('\0') != std::string_view::npos) {
    return absl::InvalidArgumentError("the request's head holds a NUL byte");
  }
  size_t lines = 0;
  for (size_t start = 0; start < head.size(); ++lines) {
    const size_t end = head.find('\n', start);
    if (end == std::string_view::npos || end == start || head[end - 1] != '\r') {
      return absl::InvalidArgumentError("a line of the request's head does not end in CR LF");
    }
    const std::string_view line = head.substr(start, end - 1 - start);
    if (line.find('\r') != std::string_view::npos) {
      return absl::InvalidArgumentError("the request's head holds a CR without LF");
    }
    if (!line.empty() && (line.front() == ' ' || line.front() == '\t')) {
      return absl::InvalidArgumentError("a line of the request's head begins with a blank; headers must not be folded");
    }
    if (lines > 0 && !line.empty()) {
      const size_t colon = line.find(':');
      if (colon == std::string_view::npos || colon == 0 || line[colon - 1] == ' ' || line[colon - 1] == '\t') {
        return absl::InvalidArgumentError("a header has no name, no colon, or a blank before its colon");
      }
    }
    start = end + 1;
  }
  // The request line and the empty line are none.
  if (lines > max_headers + 2) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("the request has %d headers; at most %d are read", lines - 2, max_headers));
  }
  return absl::OkStatus();
}

absl::Status CheckHeaders(int version, const HttpHeaders& headers) {
  const int lengths = CountHeader(headers, "Content-Length");
  const int encodings = CountHeader(headers, "Transfer-Encoding");
  if (lengths > 1) return absl::InvalidArgumentError("the request has more than one Content-Length");
  const std::string length = ValueOf(headers, "Content-Length");
  if (lengths == 1 && (length.empty() || !std::all_of(length.begin(), length.end(), absl::ascii_isdigit))) {
    return absl::InvalidArgumentError("the request's Content-Length is not a number");
  }
  if (lengths > 0 && encodings > 0) {
    return absl::InvalidArgumentError("the request has both Content-Length and Transfer-Encoding");
  }
  if (encodings > 0 && version < 11) {
    return absl::InvalidArgumentError("the request has a Transfer-Encoding, which HTTP/1.0 does not know");
  }
  if (encodings > 1 || (encodings == 1 && !absl::EqualsIgnoreCase(ValueOf(headers, "Transfer-Encoding"), "chunked"))) {
    return absl::UnimplementedError("the request's Transfer-Encoding is not known; it may only be chunked");
  }
  const int hosts = CountHeader(headers, "Host");
  if (hosts > 1 || (hosts == 0 && version >= 11)) {
    return absl::InvalidArgumentError("the request must have one Host header");
  }
  const std::string expect = ValueOf(headers, "Expect");
  if (!expect.empty() && !absl::EqualsIgnoreCase(expect, "100-continue")) {
    return absl::UnimplementedError("the request's Expect is not known; it may only be 100-continue");
  }
  return absl::OkStatus();
}

}  // namespace depthtween::server
