// The server's log: one event a line, with named values, on standard error.
#ifndef DEPTHTWEEN_SERVER_TELEMETRY_LOG_H_
#define DEPTHTWEEN_SERVER_TELEMETRY_LOG_H_

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace depthtween::server {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

struct LogOptions {
  LogLevel level = LogLevel::kInfo;  // and above
  bool json = false;                 // one object a line, for machines; otherwise text, for people
};
// Call it before other threads log; without it the defaults hold.
void ConfigureLog(const LogOptions& options);

using LogFields = std::initializer_list<std::pair<std::string_view, std::string>>;

// LogInfo("task_started", {{"task", "12"}, {"job", id}}) writes: ... task_started task=12 job=... Values with blanks or
// control characters are quoted and escaped; of a long one the first 1024 bytes are written, and how many there were.
// Threads: may be called concurrently.
void Log(LogLevel level, std::string_view event, LogFields fields = {});
inline void LogInfo(std::string_view event, LogFields fields = {}) { Log(LogLevel::kInfo, event, fields); }
inline void LogWarning(std::string_view event, LogFields fields = {}) { Log(LogLevel::kWarning, event, fields); }
inline void LogError(std::string_view event, LogFields fields = {}) { Log(LogLevel::kError, event, fields); }

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TELEMETRY_LOG_H_
