// Which file names a client may choose.
#ifndef DEPTHTWEEN_SERVER_STORE_PATH_RULES_H_
#define DEPTHTWEEN_SERVER_STORE_PATH_RULES_H_

#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace depthtween::server {

// OK for a relative path with "/" between its parts, at most 4 folders deep; each part has 1 to 255 bytes of UTF-8
// without control characters and without \ : * ? " < > |, which other systems cannot have in a name, and does not begin
// with "." (which rules out "..", "." and hidden files). Otherwise InvalidArgument that names the path and the rule it
// breaks. Control characters in the path are escaped in the message.
absl::Status CheckRelativePath(std::string_view path);

// The same of many paths: names every one that is refused, up to ten, each with its rule, and counts the others.
absl::Status CheckRelativePaths(const std::vector<std::string_view>& paths);

// Whether a sequence that is this file alone is a zip archive to be unpacked: "NAME.zip", in no folder.
bool IsArchiveName(std::string_view path);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_PATH_RULES_H_
