// The target of a request, taken apart so strictly that no two programs can read it differently.
#ifndef DEPTHTWEEN_SERVER_HTTP_TARGET_H_
#define DEPTHTWEEN_SERVER_HTTP_TARGET_H_

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/status.h"

namespace depthtween::server {

struct RequestTarget {
  std::string path;                                        // decoded
  std::vector<std::string> segments;                       // decoded; none for "/"
  std::vector<std::pair<std::string, std::string>> query;  // decoded, in the order sent
};

// "/v1/jobs/1:cancel?a=b", "http://host/v1/jobs", or "*". InvalidArgument, with the rule, for what no client of good
// will sends: no "/" at the start; empty, "." and ".." segments; percent signs without two hexadecimal digits; escaped
// "/",
// "\", "%", control characters; "\" and "#" as they are; text that is not UTF-8; more than 100 query parameters.
// In the query "+" is a blank, and "%25" and "%2F" are allowed.
absl::StatusOr<RequestTarget> ParseTarget(std::string_view target);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_TARGET_H_
