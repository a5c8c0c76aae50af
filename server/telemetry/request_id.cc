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

}  // namespace

std::string ChooseRequestId(std::string_view wanted) {
  if (IsAcceptable(wanted)) return std::string(wanted);
  thread_local std::mt19937_64 random{(uint64_t{std::random_device{}()} << 32) ^ std::random_device{}()};
  return absl::StrCat(absl::Hex(random(), absl::kZeroPad16));
}

}  // namespace depthtween::server
