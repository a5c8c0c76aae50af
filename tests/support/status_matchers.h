// Matchers for absl::Status and absl::StatusOr.
#ifndef DEPTHTWEEN_TESTS_SUPPORT_STATUS_MATCHERS_H_
#define DEPTHTWEEN_TESTS_SUPPORT_STATUS_MATCHERS_H_

#include <gmock/gmock.h>

#include <string>

#include "core/base/status.h"

namespace depthtween {

inline const absl::Status& StatusOf(const absl::Status& status) { return status; }
template <typename T>
const absl::Status& StatusOf(const absl::StatusOr<T>& result) {
  return result.status();
}

MATCHER(IsOk, "is OK") {
  *result_listener << "which is " << StatusOf(arg).ToString();
  return StatusOf(arg).ok();
}

MATCHER_P(HasCode, code, absl::StrCat("has code ", absl::StatusCodeToString(code))) {
  *result_listener << "which is " << StatusOf(arg).ToString();
  return StatusOf(arg).code() == code;
}

// This code, and a message that the matcher accepts.
MATCHER_P2(HasStatus, code, message, absl::StrCat("has status ", absl::StatusCodeToString(code))) {
  const absl::Status& status = StatusOf(arg);
  *result_listener << "which is " << status.ToString();
  return status.code() == code && testing::Matches(message)(std::string(status.message()));
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_SUPPORT_STATUS_MATCHERS_H_
