#include "server/http/target.h"

#include <google/protobuf/stubs/common.h>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"

namespace depthtween::server {
namespace {

constexpr size_t kMaxQueryParameters = 100;

int HexValue(char c) {
  if (absl::ascii_isdigit(c)) return c - '0';
  const char lower = absl::ascii_tolower(c);
  return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

enum class Part { kPath, kQuery };

absl::StatusOr<std::string> Decode(std::string_view text, Part part) {
  std::string result;
  for (size_t i = 0; i < text.size(); ++i) {
    char c = text[i];
    const bool escaped = c == '%';
    if (escaped) {
      if (i + 2 >= text.size() || HexValue(text[i + 1]) < 0 || HexValue(text[i + 2]) < 0) {
        return absl::InvalidArgumentError(
            "the request's target has a % that is not followed by two hexadecimal digits");
      }
      c = static_cast<char>(HexValue(text[i + 1]) * 16 + HexValue(text[i + 2]));
      i += 2;
    } else if (part == Part::kQuery && c == '+') {
      c = ' ';
    }
    const auto byte = static_cast<unsigned char>(c);
    // A tab or a new line may stand in a parameter, such as a text; it has no place in a path.
    const bool control = byte < ' ' || byte == 127;
    if (c == '\0' || (control && (part == Part::kPath || !escaped))) {
      return absl::InvalidArgumentError("the request's target holds a control character");
    }
    if (part == Part::kPath && (c == '\\' || c == '#' || (escaped && (c == '/' || c == '%')))) {
      return absl::InvalidArgumentError(
          "the request's path holds one of \\ # %2F %5C %25, which programs read differently; names of this server "
          "have none of them");
    }
    result.push_back(c);
  }
  if (!google::protobuf::internal::IsStructurallyValidUTF8(result.data(), static_cast<int>(result.size()))) {
    return absl::InvalidArgumentError("the request's target is not UTF-8");
  }
  return result;
}

absl::Status ParsePath(std::string_view path, RequestTarget& target) {
  if (path == "/") {
    target.path = "/";
    return absl::OkStatus();
  }
  for (size_t start = 1; start <= path.size();) {
    const size_t end = std::min(path.find('/', start), path.size());
    ASSIGN_OR_RETURN(std::string segment, Decode(path.substr(start, end - start), Part::kPath));
    if (segment.empty() || segment == "." || segment == "..") {
      return absl::InvalidArgumentError(
          absl::StrFormat("the request's path has a segment \"%s\"; it must be neither empty nor . nor ..", segment));
    }
    absl::StrAppend(&target.path, "/", segment);
    target.segments.push_back(std::move(segment));
    start = end + 1;
  }
  if (path.back() == '/') return absl::InvalidArgumentError("the request's path ends in /; leave the last / out");
  return absl::OkStatus();
}

absl::Status ParseQuery(std::string_view query, RequestTarget& target) {
  for (size_t start = 0; start < query.size();) {
    const size_t end = std::min(query.find('&', start), query.size());
    const std::string_view pair = query.substr(start, end - start);
    start = end + 1;
    if (pair.empty()) continue;
    const size_t equals = std::min(pair.find('='), pair.size());
    ASSIGN_OR_RETURN(std::string name, Decode(pair.substr(0, equals), Part::kQuery));
    ASSIGN_OR_RETURN(std::string value,
                     Decode(equals < pair.size() ? pair.substr(equals + 1) : std::string_view(), Part::kQuery));
    if (target.query.size() == kMaxQueryParameters) {
      return absl::InvalidArgumentError(
          absl::StrFormat("the request has more than %d query parameters", kMaxQueryParameters));
    }
    target.query.emplace_back(std::move(name), std::move(value));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<RequestTarget> ParseTarget(std::string_view target) {
  RequestTarget result;
  if (target == "*") {
    result.path = "*";
    return result;
  }
  // RFC 9112, 3.2.2: a server accepts the absolute form, which proxies use.
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (target.substr(0, scheme.size()) != scheme) continue;
    const size_t slash = target.find('/', scheme.size());
    target = slash == std::string_view::npos ? "/" : target.substr(slash);
    break;
  }
  if (target.empty() || target.front() != '/') {
    return absl::InvalidArgumentError("the request's target must be a path that begins with /");
  }
  const size_t question = std::min(target.find('?'), target.size());
  RETURN_IF_ERROR(ParsePath(target.substr(0, question), result));
  if (question < target.size()) RETURN_IF_ERROR(ParseQuery(target.substr(question + 1), result));
  return result;
}

}  // namespace depthtween::server
