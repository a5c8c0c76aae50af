// How a download is answered: the status line, the headers and the bytes, from what the client asks and what there is.
//
// Threads: pure functions.
#ifndef DEPTHTWEEN_SERVER_HTTP_DOWNLOAD_PLAN_H_
#define DEPTHTWEEN_SERVER_HTTP_DOWNLOAD_PLAN_H_

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "server/http/byte_range.h"
#include "server/http/exchange.h"

namespace depthtween::server {

// What there is.
struct Representation {
  std::string content_type;
  std::string etag;  // strong, with its quotes: it changes whenever the bytes do
  std::string cache_control;
  std::string disposition;            // the header Content-Disposition
  std::optional<int64_t> size_bytes;  // nullopt: not known before the bytes are made; then there is no Range
};

struct DownloadPlan {
  int status = 200;
  HttpHeaders headers;
  ByteSpan span;                          // the bytes that the answer carries
  std::optional<int64_t> content_length;  // nullopt: in chunks
  bool sends_body = false;                // false of HEAD, and of an answer without a body
};

// For GET and HEAD. A 304 and a 416 are answers as well.
DownloadPlan PlanDownload(const HttpRequest& request, const Representation& representation);

// Whether PlanDownload would look at Range, so that the size must be known.
bool WantsRange(const HttpRequest& request, std::string_view etag);

// By the extension of a file's name.
std::string_view ContentTypeOf(std::string_view file_name);
// "inline" or "attachment" with the file's name, in which all but letters, digits and "._-" become "_".
std::string Disposition(std::string_view kind, std::string_view file_name);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_DOWNLOAD_PLAN_H_
