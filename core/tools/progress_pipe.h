// Tells the process that started this one how its task gets on: one JSON object a line on a pipe.
//
//   {"stage": "flow", "interval": 3}                         a stage begins; or {"stage": "scene flow, frame 17 of 64"}
//   {"frame": 17, "interval": 3}                             its files are on the disk
//   {"interval_done": 3, "seconds": 0.61, "frames": 8}       so is the interval's report
//   {"checked": 12, "of": 66}                                files of a sequence
//   {"alive": 17}                                            some other work was done, of seconds since the start
//   {"error": {"code": "RESOURCE_EXHAUSTED", "message": ""}} the last line of a task that failed; has a "field" when
//   one
//                                                            of the options is to blame
#ifndef DEPTHTWEEN_CORE_TOOLS_PROGRESS_PIPE_H_
#define DEPTHTWEEN_CORE_TOOLS_PROGRESS_PIPE_H_

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>

#include "core/base/status.h"

namespace depthtween::tools {

// Threads: safe to call concurrently; a line is written by one call and not torn.
class ProgressPipe {
 public:
  // `fd` stays the caller's; below 0, lines go nowhere. `on_reader_gone` is called when nobody reads any more: the
  // work is then for no one. SIGPIPE must be ignored.
  ProgressPipe(int fd, std::function<void()> on_reader_gone) : fd_(fd), on_reader_gone_(std::move(on_reader_gone)) {}

  bool connected() const { return fd_ >= 0; }
  void Send(const nlohmann::json& line);
  // Says so, unless something was sent less than a second ago.
  void SendAlive();
  void SendError(const absl::Status& status);

 private:
  // Seconds since the start.
  int64_t Now() const {
    return std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now() - start_).count();
  }

  const int fd_;
  const std::function<void()> on_reader_gone_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::atomic<int64_t> last_sent_{0};  // Now() of the last line
};

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_PROGRESS_PIPE_H_
