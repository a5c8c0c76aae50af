// The server's log: one event a line, with named values, on standard error.
#ifndef DEPTHTWEEN_SERVER_TELEMETRY_LOG_H_
#define DEPTHTWEEN_SERVER_TELEMETRY_LOG_H_

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace depthtween::server {

using LogFields = std::initializer_list<std::pair<std::string_view, std::string>>;

// LogInfo("task_started", {{"task", "12"}, {"job", id}}) writes: ... task_started task=12 job=... Values with blanks or
// control characters are quoted and escaped. Threads: may be called concurrently.
void LogInfo(std::string_view event, LogFields fields = {});
void LogWarning(std::string_view event, LogFields fields = {});
void LogError(std::string_view event, LogFields fields = {});

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TELEMETRY_LOG_H_
