#include "server/http/exchange.h"

#include <algorithm>
#include <array>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"

namespace depthtween::server {

bool SameHeader(std::string_view left, std::string_view right) {
  return absl::EqualsIgnoreCase({left.data(), left.size()}, {right.data(), right.size()});
}

std::optional<std::string> HttpRequest::Header(std::string_view name) const {
  std::optional<std::string> result;
  for (const auto& [key, value] : headers) {
    if (!SameHeader(key, name)) continue;
    result = result ? absl::StrCat(*result, ", ", value) : value;
  }
  return result;
}

std::optional<std::string> HttpRequest::Query(std::string_view name) const {
  for (const auto& [key, value] : query) {
    if (key == name) return value;
  }
  return std::nullopt;
}

boost::asio::awaitable<absl::StatusOr<std::string>> Exchange::ReadBody(size_t max_bytes) {
  std::string body;
  std::array<char, 16384> piece;  // NOLINT(cppcoreguidelines-pro-type-member-init): filled before it is read
  while (true) {
    CO_ASSIGN_OR_RETURN(const size_t count, co_await ReadSome(piece.data(), piece.size()));
    if (count == 0) co_return body;
    if (count > max_bytes - body.size()) {
      co_return absl::ResourceExhaustedError(
          absl::StrFormat("the request's body is larger than %d bytes, which is the limit here", max_bytes));
    }
    body.append(piece.data(), count);
  }
}

std::unique_ptr<Exchange::GoneWatch> Exchange::WhenGone(std::function<void()> callback) {
  if (gone_) callback();
  watches_.push_back(std::move(callback));
  return std::make_unique<GoneWatch>(*this, std::prev(watches_.end()));
}

void Exchange::MarkGone() {
  if (gone_) return;
  gone_ = true;
  // By copy: a callback may forget itself.
  const std::vector<std::function<void()>> callbacks(watches_.begin(), watches_.end());
  for (const auto& callback : callbacks) callback();
}

}  // namespace depthtween::server
