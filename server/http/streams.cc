#include "server/http/streams.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "server/http/errors.h"

namespace depthtween::server {
namespace {

// Each line of the text becomes a field, so that no text can end its event.
void AppendData(std::string_view text, std::string& event) {
  for (size_t start = 0; start <= text.size();) {
    const size_t end = std::min(text.find_first_of("\r\n", start), text.size());
    absl::StrAppend(&event, "data: ", std::string(text.substr(start, end - start)), "\n");
    start = end + 1;
  }
}

}  // namespace

std::string NdjsonMessage(std::string_view json) { return absl::StrCat(std::string(json), "\n"); }

std::string NdjsonError(const google::rpc::Status& error) {
  return absl::StrCat("{\"error\":", ErrorJson(error), "}\n");
}

std::string SseMessage(std::string_view id, std::string_view json) {
  std::string event;
  // A line break would end the field, and NUL voids it (HTML standard, 9.2.6).
  if (!id.empty() && id.find_first_of(std::string_view("\r\n\0", 3)) == std::string_view::npos) {
    event = absl::StrCat("id: ", std::string(id), "\n");
  }
  AppendData(json, event);
  event.push_back('\n');
  return event;
}

std::string SseError(const google::rpc::Status& error) {
  std::string event = "event: error\n";
  AppendData(ErrorJson(error), event);
  event.push_back('\n');
  return event;
}

std::string SseEnd() { return "event: end\ndata: {}\n\n"; }

std::string SseHeartbeat() { return ": heartbeat\n\n"; }

bool Accepts(std::string_view accept, std::string_view media_type) {
  const std::vector<std::string> ranges = absl::StrSplit(std::string(accept), ',');
  return std::any_of(ranges.begin(), ranges.end(), [media_type](const std::string& range) {
    const absl::string_view type = absl::StripAsciiWhitespace(absl::string_view(range).substr(0, range.find(';')));
    return absl::EqualsIgnoreCase(type, {media_type.data(), media_type.size()});
  });
}

}  // namespace depthtween::server
