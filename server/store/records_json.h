// Parts of records that the database keeps as JSON text.
#ifndef DEPTHTWEEN_SERVER_STORE_RECORDS_JSON_H_
#define DEPTHTWEEN_SERVER_STORE_RECORDS_JSON_H_

#include <string>

#include "core/base/status.h"
#include "server/store/error_info.h"
#include "server/store/records.h"

namespace depthtween::server {

std::string ToJson(const Recording& recording);
std::string ToJson(const ValidationResult& result);
// Without progress, which is counted elsewhere.
std::string ToJson(const RenderRecord& render);
std::string ToJson(const ErrorInfo& info);

// DataLoss for text that the functions above did not write.
absl::StatusOr<Recording> RecordingFromJson(const std::string& text);
absl::StatusOr<ValidationResult> ValidationResultFromJson(const std::string& text);
absl::StatusOr<RenderRecord> RenderRecordFromJson(const std::string& text);
absl::StatusOr<ClockEstimate> ReadClockEstimate(const std::string& text);
absl::StatusOr<std::vector<std::string>> ReadWarnings(const std::string& text);
absl::StatusOr<ErrorInfo> ErrorInfoFromJson(const std::string& text);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_RECORDS_JSON_H_
