#include "server/telemetry/request_id.h"

#include <algorithm>
#include <cstdint>
#include <random>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace depthtween::server {
namespace {

constexpr size_t kMaxBytes = 64;  // fits two UUIDs or a W3C trace context

bool IsAcceptable(std::string_view id) {
  return !id.empty() && id.size() <= kMaxBytes && std::all_of(id.begin(), id.end(), [](unsigned char c) {
    return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-';
  });
}

constexpr size_t kTraceBegin = 3, kTraceBytes = 32, kSpanBegin = 36, kSpanBytes = 16;

// Version 00; ids of zeros alone are none.
bool IsTraceparent(std::string_view value) {
  constexpr std::string_view kShape = "00-xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx-xxxxxxxxxxxxxxxx-xx";
  if (value.size() != kShape.size()) return false;
  for (size_t i = 0; i < value.size(); ++i) {
    const char c = value[i];
    const bool fits = kShape[i] == 'x' ? absl::ascii_isdigit(c) || (c >= 'a' && c <= 'f') : c == kShape[i];
    if (!fits) return false;
  }
  const auto is_set = [](std::string_view id) { return id.find_first_not_of('0') != std::string_view::npos; };
  return is_set(value.substr(kTraceBegin, kTraceBytes)) && is_set(value.substr(kSpanBegin, kSpanBytes));
}

std::string Random16() {
  thread_local std::mt19937_64 random{(uint64_t{std::random_device{}()} << 32) ^ std::random_device{}()};
  return absl::StrCat(absl::Hex(random(), absl::kZeroPad16));
}

}  // namespace

std::string ChooseRequestId(std::string_view wanted) {
  if (IsAcceptable(wanted)) return std::string(wanted);
  return Random16();
}

std::string ContinueTrace(std::string_view given) {
  if (!IsTraceparent(given)) return absl::StrCat("00-", Random16(), Random16(), "-", Random16(), "-00");
  std::string next(given);
  return next.replace(kSpanBegin, kSpanBytes, Random16());
}

std::string TraceOf(std::string_view traceparent) { return std::string(traceparent.substr(kTraceBegin, kTraceBytes)); }

}  // namespace depthtween::server
