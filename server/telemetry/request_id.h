// Names for each call, so that a client's report, an error and the log lines can be put together.
#ifndef DEPTHTWEEN_SERVER_TELEMETRY_REQUEST_ID_H_
#define DEPTHTWEEN_SERVER_TELEMETRY_REQUEST_ID_H_

#include <string>
#include <string_view>

namespace depthtween::server {

// The metadata key under which a client may send its own, and under which the server answers with the one in use.
inline constexpr char kRequestIdKey[] = "x-request-id";

// `wanted` if it is 1 to 64 letters, digits or "._-", else 16 random hexadecimal digits.
std::string ChooseRequestId(std::string_view wanted);

// W3C Trace Context (https://www.w3.org/TR/trace-context/): which trace of a larger system a call belongs to.
inline constexpr char kTraceparentKey[] = "traceparent";

// The header for what this server does: a new span in the trace of `given`, or if that is not well-formed, the first of
// a new trace. "00-<trace, 32 hexadecimal digits>-<span, 16>-<flags, 2>".
std::string ContinueTrace(std::string_view given);
// The trace of such a header, for logs.
std::string TraceOf(std::string_view traceparent);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TELEMETRY_REQUEST_ID_H_
