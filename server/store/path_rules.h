// Which file names a client may choose.
#ifndef DEPTHTWEEN_SERVER_STORE_PATH_RULES_H_
#define DEPTHTWEEN_SERVER_STORE_PATH_RULES_H_

#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

// OK for a relative path with "/" between its parts, at most 4 folders deep; each part has 1 to 255 bytes of ASCII
// letters, digits and "._-+ ", and does not begin with "." (which rules out "..", "." and hidden files). Otherwise
// InvalidArgument that names the path and the rule it breaks. Control characters in the path are escaped in the
// message.
absl::Status CheckRelativePath(std::string_view path);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_PATH_RULES_H_
