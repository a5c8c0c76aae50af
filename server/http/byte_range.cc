#include "server/http/byte_range.h"

#include <algorithm>
#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace depthtween::server {
namespace {

constexpr int64_t kHuge = std::numeric_limits<int64_t>::max();

std::string_view TrimBlanks(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

bool AllDigits(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](unsigned char c) { return absl::ascii_isdigit(c); });
}

// A position in a Range header: one beyond 2^63 - 1 is beyond the end of everything, which is no error.
std::optional<int64_t> ParsePosition(std::string_view text) {
  if (!AllDigits(text)) return std::nullopt;
  return ParseByteCount(text).value_or(kHuge);
}

bool StartsWithBytesUnit(std::string_view text) {
  constexpr std::string_view kUnit = "bytes";
  if (text.size() < kUnit.size()) return false;
  for (size_t i = 0; i < kUnit.size(); ++i) {
    if (absl::ascii_tolower(static_cast<unsigned char>(text[i])) != kUnit[i]) return false;
  }
  return true;
}

// One "a-b", "a-" or "-n". nullopt if it cannot be read; an empty span if it lies outside.
std::optional<ByteSpan> ParseOneRange(std::string_view text, int64_t size_bytes) {
  const size_t dash = text.find('-');
  if (dash == std::string_view::npos) return std::nullopt;
  const std::string_view before = text.substr(0, dash), after = text.substr(dash + 1);
  if (before.empty()) {
    const std::optional<int64_t> count = ParsePosition(after);
    if (!count) return std::nullopt;
    const int64_t size = std::min(*count, size_bytes);
    return ByteSpan{size_bytes - size, size};
  }
  const std::optional<int64_t> first = ParsePosition(before);
  const std::optional<int64_t> last = after.empty() ? kHuge : ParsePosition(after);
  if (!first || !last || *last < *first) return std::nullopt;
  if (*first >= size_bytes) return ByteSpan{};
  return ByteSpan{*first, std::min(*last, size_bytes - 1) - *first + 1};
}

// Takes the next entity tag off a list: its quoted part, and whether it is weak. False at the end, or where the list
// cannot be read.
bool TakeTag(std::string_view& list, std::string_view* tag, bool* weak) {
  while (!list.empty() && (list.front() == ' ' || list.front() == '\t' || list.front() == ',')) list.remove_prefix(1);
  *weak = list.substr(0, 2) == "W/";
  if (*weak) list.remove_prefix(2);
  if (list.empty() || list.front() != '"') return false;
  const size_t end = list.find('"', 1);
  if (end == std::string_view::npos) return false;
  *tag = list.substr(0, end + 1);
  list.remove_prefix(end + 1);
  return true;
}

bool ListsTag(std::string_view list, std::string_view etag, bool weak_counts) {
  if (TrimBlanks(list) == "*") return true;
  std::string_view tag;
  bool weak = false;
  while (TakeTag(list, &tag, &weak)) {
    if (tag == etag && (weak_counts || !weak)) return true;
  }
  return false;
}

absl::Status BadUploadRange(std::string_view content_range) {
  const std::string shown = absl::CHexEscape({content_range.data(), std::min<size_t>(content_range.size(), 80)});
  return absl::InvalidArgumentError(
      absl::StrCat("Content-Range = \"", shown,
                   "\", must be \"bytes FIRST-LAST/SIZE\", LAST the position of the last byte, or \"bytes */SIZE\""));
}

}  // namespace

std::optional<int64_t> ParseByteCount(std::string_view text) {
  if (!AllDigits(text)) return std::nullopt;
  int64_t value = 0;
  for (const char digit : text) {
    if (value > (kHuge - (digit - '0')) / 10) return std::nullopt;
    value = 10 * value + (digit - '0');
  }
  return value;
}

RangeChoice ChooseRange(std::string_view range, int64_t size_bytes) {
  constexpr RangeChoice kWhole;
  std::string_view rest = TrimBlanks(range);
  if (!StartsWithBytesUnit(rest)) return kWhole;
  rest = rest.substr(5);
  if (rest.empty() || rest.front() != '=') return kWhole;
  rest.remove_prefix(1);
  int count = 0;
  ByteSpan satisfiable;
  while (true) {
    const size_t comma = rest.find(',');
    const std::string_view one = TrimBlanks(rest.substr(0, comma));
    if (!one.empty()) {  // lists may have empty elements
      const std::optional<ByteSpan> span = ParseOneRange(one, size_bytes);
      if (!span) return kWhole;
      ++count;
      if (span->size > 0) satisfiable = *span;
    }
    if (comma == std::string_view::npos) break;
    rest.remove_prefix(comma + 1);
  }
  if (count == 0) return kWhole;
  if (satisfiable.size == 0) return {.kind = RangeChoice::Kind::kUnsatisfiable, .span = {}};
  if (count > 1) return kWhole;
  return {.kind = RangeChoice::Kind::kPart, .span = satisfiable};
}

std::string ContentRange(const ByteSpan& span, int64_t size_bytes) {
  return absl::StrCat("bytes ", span.offset, "-", span.offset + span.size - 1, "/", size_bytes);
}

std::string UnsatisfiedRange(int64_t size_bytes) { return absl::StrCat("bytes */", size_bytes); }

Precondition CheckPreconditions(std::string_view if_match, std::string_view if_none_match, std::string_view etag) {
  if (!if_match.empty() && !ListsTag(if_match, etag, /*weak_counts=*/false)) return Precondition::kFailed;
  if (!if_none_match.empty() && ListsTag(if_none_match, etag, /*weak_counts=*/true)) return Precondition::kNotModified;
  return Precondition::kHolds;
}

bool IfRangeHolds(std::string_view if_range, std::string_view etag) {
  return if_range.empty() || TrimBlanks(if_range) == etag;
}

absl::StatusOr<UploadRange> ParseUploadRange(std::string_view content_range) {
  std::string_view rest = TrimBlanks(content_range);
  if (!StartsWithBytesUnit(rest)) return BadUploadRange(content_range);
  rest = rest.substr(5);
  if (rest.empty() || rest.front() != ' ') return BadUploadRange(content_range);
  rest = TrimBlanks(rest);
  const size_t slash = rest.find('/');
  if (slash == std::string_view::npos) return BadUploadRange(content_range);
  const std::string_view span = rest.substr(0, slash), total = rest.substr(slash + 1);
  UploadRange result;
  if (total != "*") {
    result.size_bytes = ParseByteCount(total);
    if (!result.size_bytes) return BadUploadRange(content_range);
  }
  if (span == "*") {
    if (!result.size_bytes) return BadUploadRange(content_range);
    return result;
  }
  const size_t dash = span.find('-');
  if (dash == std::string_view::npos) return BadUploadRange(content_range);
  const std::optional<int64_t> first = ParseByteCount(span.substr(0, dash));
  const std::optional<int64_t> last = ParseByteCount(span.substr(dash + 1));
  if (!first || !last || *last < *first || *last == kHuge) return BadUploadRange(content_range);
  if (result.size_bytes && *last >= *result.size_bytes) return BadUploadRange(content_range);
  result.span = ByteSpan{*first, *last - *first + 1};
  return result;
}

}  // namespace depthtween::server
