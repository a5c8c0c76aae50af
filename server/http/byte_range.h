// Which bytes an answer carries: Range, If-Range, If-Match and If-None-Match of downloads, and Content-Range of uploads
// (RFC 9110, sections 8.8, 13 and 14).
//
// Threads: pure functions.
#ifndef DEPTHTWEEN_SERVER_HTTP_BYTE_RANGE_H_
#define DEPTHTWEEN_SERVER_HTTP_BYTE_RANGE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

// Decimal digits and nothing else. nullopt for anything else, or beyond 2^63 - 1.
std::optional<int64_t> ParseByteCount(std::string_view text);

// Some bytes of a representation: `offset` and `size` in bytes.
struct ByteSpan {
  int64_t offset = 0;
  int64_t size = 0;
  bool operator==(const ByteSpan&) const = default;
};

struct RangeChoice {
  enum class Kind {
    kWhole,          // 200: no Range, one of another unit or that cannot be read, or several ranges
    kPart,           // 206: `span`
    kUnsatisfiable,  // 416: nothing of what is asked for exists
  };
  Kind kind = Kind::kWhole;
  ByteSpan span;  // of kPart; has at least one byte
};

// What a Range header asks of a representation of `size_bytes`. Several ranges of which at least one can be had are
// answered whole: a client that asks so can always take that, and nobody needs multipart bodies of depth maps.
RangeChoice ChooseRange(std::string_view range, int64_t size_bytes);

// "bytes 2-5/10": the Content-Range header of a 206.
std::string ContentRange(const ByteSpan& span, int64_t size_bytes);
// "bytes */10": that of a 416.
std::string UnsatisfiedRange(int64_t size_bytes);

// `etag` is a strong entity tag with its quotes. What the request's conditions say of the representation that has it.
enum class Precondition {
  kHolds,
  kNotModified,  // 304: If-None-Match lists it
  kFailed,       // 412: If-Match does not list it
};
Precondition CheckPreconditions(std::string_view if_match, std::string_view if_none_match, std::string_view etag);
// Whether Range counts: there is no If-Range, or it names exactly this strong tag. A date never does, because no answer
// carries Last-Modified.
bool IfRangeHolds(std::string_view if_range, std::string_view etag);

// The Content-Range of an upload.
struct UploadRange {
  std::optional<ByteSpan> span;       // nullopt: "bytes */10", which asks how far the upload is
  std::optional<int64_t> size_bytes;  // nullopt: "bytes 2-5/*"
};
// Errors: InvalidArgument that says what it must look like.
absl::StatusOr<UploadRange> ParseUploadRange(std::string_view content_range);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_BYTE_RANGE_H_
