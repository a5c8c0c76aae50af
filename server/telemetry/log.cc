#include "server/telemetry/log.h"

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "spdlog/sinks/stdout_sinks.h"
#include "spdlog/spdlog.h"

namespace depthtween::server {
namespace {

struct State {
  State() : logger("server", std::make_shared<spdlog::sinks::stderr_sink_mt>()) {
    logger.set_pattern("%v");
    logger.flush_on(spdlog::level::trace);
  }
  spdlog::logger logger;
  bool json = false;
};

State& Current() {
  static State state;
  return state;
}

spdlog::level::level_enum ToSpdlog(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarning:
      return spdlog::level::warn;
    case LogLevel::kError:
      return spdlog::level::err;
  }
  return spdlog::level::err;
}

absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

// A value may be as long as what a client sent, and a log must not grow by what anybody sends.
constexpr size_t kMaxValueBytes = 1024;

std::string Bounded(const std::string& value) {
  if (value.size() <= kMaxValueBytes) return value;
  // Not in the middle of a character: its further bytes are 10xxxxxx.
  size_t end = kMaxValueBytes;
  while (end > kMaxValueBytes - 4 && (static_cast<unsigned char>(value[end]) & 0xC0U) == 0x80U) --end;
  return absl::StrCat(value.substr(0, end), "... (", value.size(), " bytes)");
}

std::string JsonLine(const std::string& time, const std::string& level, std::string_view event, LogFields fields) {
  nlohmann::ordered_json line = {{"time", time}, {"level", level}, {"event", event}};
  for (const auto& [name, value] : fields) line[std::string(name)] = Bounded(value);
  // Values may quote what clients sent, which need not be UTF-8.
  return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

std::string TextLine(const std::string& time, const std::string& level, std::string_view event, LogFields fields) {
  std::string line = absl::StrCat(time, " ", level, " ", View(event));
  for (const auto& [name, whole] : fields) {
    const std::string value = Bounded(whole);
    const bool plain = !value.empty() &&
                       std::all_of(value.begin(), value.end(), [](char c) { return c > ' ' && c < 127 && c != '"'; });
    absl::StrAppend(&line, " ", View(name), "=",
                    plain ? value : absl::StrCat("\"", absl::Utf8SafeCEscape(value), "\""));
  }
  return line;
}

}  // namespace

void ConfigureLog(const LogOptions& options) {
  Current().logger.set_level(ToSpdlog(options.level));
  Current().json = options.json;
}

void Log(LogLevel level, std::string_view event, LogFields fields) {
  State& state = Current();
  const spdlog::level::level_enum severity = ToSpdlog(level);
  if (!state.logger.should_log(severity)) return;
  const std::string time = absl::FormatTime("%Y-%m-%dT%H:%M:%E6SZ", absl::Now(), absl::UTCTimeZone());
  const auto name = spdlog::level::to_string_view(severity);
  const std::string level_name(name.data(), name.size());
  state.logger.log(severity, "{}", (state.json ? JsonLine : TextLine)(time, level_name, event, fields));
}

}  // namespace depthtween::server
