#include "server/telemetry/log.h"

#include <algorithm>
#include <memory>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "spdlog/sinks/stdout_sinks.h"
#include "spdlog/spdlog.h"

namespace depthtween::server {
namespace {

spdlog::logger& Logger() {
  static const std::shared_ptr<spdlog::logger> logger = [] {
    auto made = std::make_shared<spdlog::logger>("server", std::make_shared<spdlog::sinks::stderr_sink_mt>());
    made->set_pattern("%Y-%m-%dT%H:%M:%S.%f%z %l %v");
    made->flush_on(spdlog::level::info);
    return made;
  }();
  return *logger;
}

absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

void Write(spdlog::level::level_enum level, std::string_view event, LogFields fields) {
  std::string line(event);
  for (const auto& [name, value] : fields) {
    const bool plain = !value.empty() &&
                       std::all_of(value.begin(), value.end(), [](char c) { return c > ' ' && c < 127 && c != '"'; });
    absl::StrAppend(&line, " ", View(name), "=",
                    plain ? value : absl::StrCat("\"", absl::Utf8SafeCEscape(value), "\""));
  }
  Logger().log(level, "{}", line);
}

}  // namespace

void LogInfo(std::string_view event, LogFields fields) { Write(spdlog::level::info, event, fields); }
void LogWarning(std::string_view event, LogFields fields) { Write(spdlog::level::warn, event, fields); }
void LogError(std::string_view event, LogFields fields) { Write(spdlog::level::err, event, fields); }

}  // namespace depthtween::server
