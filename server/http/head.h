// What is checked of a request's head before Boost.Beast parses it: forms that were allowed once and that programs in a
// row read differently, so that one of them sees another request than the next (request smuggling).
#ifndef DEPTHTWEEN_SERVER_HTTP_HEAD_H_
#define DEPTHTWEEN_SERVER_HTTP_HEAD_H_

#include <string_view>

#include "core/base/status.h"
#include "server/http/exchange.h"

namespace depthtween::server {

// The bytes up to and with the empty line. InvalidArgument: a line that does not end in CR LF; a CR or NUL elsewhere; a
// line that begins with a blank (obs-fold); a blank before the colon. ResourceExhausted: more than `max_headers` lines.
absl::Status CheckHeadBytes(std::string_view head, size_t max_headers);

// The parsed headers of a request with version 1.0 (10) or 1.1 (11). InvalidArgument: Content-Length that is no number,
// more than once, or together with Transfer-Encoding; Transfer-Encoding in 1.0; Host missing or more than once in 1.1.
// Unimplemented: a Transfer-Encoding other than "chunked"; an Expect other than "100-continue".
absl::Status CheckHeaders(int version, const HttpHeaders& headers);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_HEAD_H_
