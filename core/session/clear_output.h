// Making room for what a command writes.
#ifndef DEPTHTWEEN_CORE_SESSION_CLEAR_OUTPUT_H_
#define DEPTHTWEEN_CORE_SESSION_CLEAR_OUTPUT_H_

#include <initializer_list>
#include <string>

#include "core/base/status.h"

namespace depthtween {

// Makes sure that the folder `out` may be written to: new, empty, or with `force` an earlier one, whose `parts` are
// removed so that nothing of it survives among the new files. Everything else in the folder stays. `replaces` says in
// messages what --force replaces, such as "an earlier result".
//
// Errors: InvalidArgument when `out` is no folder, AlreadyExists when it is not empty and `force` is not given.
absl::Status ClearOutput(const std::string& out, bool force, const std::string& replaces,
                         std::initializer_list<const char*> parts);

// The same for a result. InvalidArgument when the folder holds a recording.
absl::Status ClearResult(const std::string& out, bool force, std::initializer_list<const char*> parts);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_CLEAR_OUTPUT_H_
