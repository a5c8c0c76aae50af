// Errors travel as values: absl::Status and absl::StatusOr at every module boundary, with the two macros that pass them
// on.
//
// Codes, as used throughout:  InvalidArgument names field, value and rule.  NotFound: no such file or resource.
// FailedPrecondition: the wrong state.  ResourceExhausted: a limit or a full disk.  DataLoss: damaged bytes.
// Unavailable: the system has no file descriptor left.  Cancelled: a stop token fired.  Internal: a bug of
// ours or a failed system call.
#ifndef DEPTHTWEEN_CORE_BASE_STATUS_H_
#define DEPTHTWEEN_CORE_BASE_STATUS_H_

#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#define DEPTHTWEEN_CONCAT_INNER(a, b) a##b
#define DEPTHTWEEN_CONCAT(a, b) DEPTHTWEEN_CONCAT_INNER(a, b)

#define RETURN_IF_ERROR(expression)                                         \
  do {                                                                      \
    if (absl::Status status_ = (expression); !status_.ok()) return status_; \
  } while (false)

#define ASSIGN_OR_RETURN(declaration, expression) \
  ASSIGN_OR_RETURN_IMPL(DEPTHTWEEN_CONCAT(status_or_, __LINE__), declaration, expression)
#define ASSIGN_OR_RETURN_IMPL(temporary, declaration, expression) \
  auto temporary = (expression);                                  \
  if (!temporary.ok()) return std::move(temporary).status();      \
  declaration = *std::move(temporary)

namespace depthtween {

// The same status with "context: " before its message: adds the file or field that only the caller knows.
absl::Status WithContext(const absl::Status& status, std::string_view context);

// The status of a failed system call: NotFound for ENOENT, ResourceExhausted for ENOSPC, EDQUOT and EFBIG,
// Unavailable for EMFILE and ENFILE, PermissionDenied for EACCES and EPERM, Internal otherwise. `what` says what was
// being done to which file.
absl::Status ErrnoStatus(int error_number, std::string_view what);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_STATUS_H_
