// The names of resources, such as "jobs/{job}/outputs/{output}", and the ids in them.
#ifndef DEPTHTWEEN_SERVER_STORE_RESOURCE_NAMES_H_
#define DEPTHTWEEN_SERVER_STORE_RESOURCE_NAMES_H_

#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

// `field` is where the request has the name. An id has 1 to 64 letters, digits, "-" and "_". InvalidArgument
// (BAD_FIELD) for anything else.

// 16 random hexadecimal digits.
std::string NewId();

std::string SequenceName(std::string_view id);
std::string UploadName(std::string_view sequence_id, std::string_view upload_id);
std::string JobName(std::string_view id);
std::string OutputName(std::string_view job_id, std::string_view output_id);

absl::StatusOr<std::string> ParseSequenceName(std::string_view field, std::string_view name);
absl::StatusOr<std::string> ParseJobName(std::string_view field, std::string_view name);
struct UploadIds {
  std::string sequence_id, upload_id;
};
absl::StatusOr<UploadIds> ParseUploadName(std::string_view field, std::string_view name);
struct OutputIds {
  std::string job_id, output_id;
};
absl::StatusOr<OutputIds> ParseOutputName(std::string_view field, std::string_view name);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_RESOURCE_NAMES_H_
