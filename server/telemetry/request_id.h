// A name for each call, so that a client's report, an error and the log lines can be put together.
#ifndef DEPTHTWEEN_SERVER_TELEMETRY_REQUEST_ID_H_
#define DEPTHTWEEN_SERVER_TELEMETRY_REQUEST_ID_H_

#include <string>
#include <string_view>

namespace depthtween::server {

// The metadata key under which a client may send its own, and under which the server answers with the one in use.
inline constexpr char kRequestIdKey[] = "x-request-id";

// `wanted` if it is 1 to 64 letters, digits or "._-", else 16 random hexadecimal digits.
std::string ChooseRequestId(std::string_view wanted);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TELEMETRY_REQUEST_ID_H_
