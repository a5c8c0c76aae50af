// Errors about one field of a JSON document, which remember its path: a server passes it on to the client.
#ifndef DEPTHTWEEN_CORE_OPTIONS_FIELD_ERROR_H_
#define DEPTHTWEEN_CORE_OPTIONS_FIELD_ERROR_H_

#include <string>

#include "core/base/status.h"

namespace depthtween {

// InvalidArgument about a field, "<path> <what>", that remembers the path.
absl::Status FieldError(const std::string& path, const std::string& what);
// `status`, whose message begins with a field of the object at `path`, about the whole path. Others stay as they are.
absl::Status InObject(const std::string& path, const absl::Status& status);
// The path that FieldError or InObject put there; empty if there is none.
std::string FieldOf(const absl::Status& status);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_OPTIONS_FIELD_ERROR_H_
