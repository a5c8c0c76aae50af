// Any bytes as the headers Range, If-None-Match and Content-Range: whatever is chosen lies within what there is, and
// means the same when it is written out.
#include "server/http/byte_range.h"

#include <cstdlib>
#include <string>

#include "absl/strings/str_cat.h"

using namespace depthtween::server;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  const int64_t size_bytes = data[0];
  const std::string_view header(reinterpret_cast<const char*>(data) + 1, size - 1);
  const RangeChoice choice = ChooseRange(header, size_bytes);
  if (choice.kind == RangeChoice::Kind::kPart) {
    const ByteSpan& span = choice.span;
    if (span.offset < 0 || span.size <= 0 || span.size > size_bytes - span.offset) std::abort();
    const RangeChoice again =
        ChooseRange(absl::StrCat("bytes=", span.offset, "-", span.offset + span.size - 1), size_bytes);
    if (again.kind != choice.kind || !(again.span == span)) std::abort();
  }
  if (const auto range = ParseUploadRange(header); range.ok() && range->span) {
    const ByteSpan& span = *range->span;
    if (span.offset < 0 || span.size <= 0) std::abort();
    if (range->size_bytes && span.size > *range->size_bytes - span.offset) std::abort();
  }
  if (CheckPreconditions(header, "", "\"a\"") == Precondition::kNotModified) std::abort();
  if (CheckPreconditions("", header, "\"a\"") == Precondition::kFailed) std::abort();
  return 0;
}
