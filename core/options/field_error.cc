#include "core/options/field_error.h"

#include <algorithm>

namespace depthtween {
namespace {

constexpr char kFieldPayload[] = "depthtween/field";

}  // namespace

absl::Status FieldError(const std::string& path, const std::string& what) {
  absl::Status status = absl::InvalidArgumentError(absl::StrCat(path, " ", what));
  status.SetPayload(kFieldPayload, absl::Cord(path));
  return status;
}

absl::Status InObject(const std::string& path, const absl::Status& status) {
  if (!absl::IsInvalidArgument(status)) return status;
  const absl::string_view message = status.message();
  const size_t end = std::min(message.find(' '), message.size());
  return FieldError(absl::StrCat(path, ".", message.substr(0, end)),
                    std::string(message.substr(std::min(end + 1, message.size()))));
}

std::string FieldOf(const absl::Status& status) {
  const auto payload = status.GetPayload(kFieldPayload);
  return payload ? std::string(*payload) : std::string();
}

}  // namespace depthtween
