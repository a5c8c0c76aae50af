#include "core/tools/progress_pipe.h"

#include <unistd.h>
#include <nlohmann/json.hpp>

#include <cerrno>
#include <string>
#include <utility>

#include "core/session/render_options.h"
#include "core/session/render_run.h"

namespace depthtween::tools {

void ProgressPipe::Send(const nlohmann::json& line) {
  if (!connected()) return;
  last_sent_ = Now();
  // File names may hold any bytes; JSON may not.
  const std::string text = line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  // A pipe takes up to PIPE_BUF (4096) bytes whole; only a long error message can need a second write, and it is the
  // last line.
  for (size_t sent = 0; sent < text.size();) {
    const ssize_t count = write(fd_, text.data() + sent, text.size() - sent);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return on_reader_gone_();
    sent += static_cast<size_t>(count);
  }
}

void ProgressPipe::SendAlive() {
  int64_t last = last_sent_;
  const int64_t now = Now();
  // Of several threads one says it.
  if (now > last && last_sent_.compare_exchange_strong(last, now)) Send({{"alive", now}});
}

void ProgressPipe::SendError(const absl::Status& status) {
  nlohmann::json error = {{"code", absl::StatusCodeToString(status.code())},
                          {"message", std::string(status.message().data(), status.message().size())}};
  if (const std::string field = FieldOf(status); !field.empty()) error["field"] = field;
  if (nlohmann::json lost = LostOf(status); !lost.is_null()) error["lost"] = std::move(lost);
  Send({{"error", std::move(error)}});
}

}  // namespace depthtween::tools
