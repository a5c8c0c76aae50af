// Runs the stages of one interval: each is timed and announced, and stops between items when the caller asks to.
//
// Threads: one StageRunner belongs to one thread; SideBySide calls its body from several.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_STAGE_RUNNER_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_STAGE_RUNNER_H_

#include <chrono>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/base/status.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

class StageRunner {
 public:
  explicit StageRunner(const RunContext& context) : context_(context) {}

  // Body: absl::Status() or absl::StatusOr<T>(), which is returned. Its seconds are added to the summary under `name`.
  template <typename Body>
  auto Stage(const char* name, const Body& body) -> decltype(body()) {
    if (context_.stop.stop_requested()) return absl::CancelledError("stopped on request");
    if (context_.on_stage) context_.on_stage(name);
    const auto start = std::chrono::steady_clock::now();
    auto made = body();
    summary_.stage_seconds[name] += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return made;
  }

  // Body: absl::Status(int). Runs body(i) for count items side by side and returns the first error in item order.
  template <typename Body>
  absl::Status SideBySide(int count, const Body& body) const {
    std::vector<absl::Status> statuses(count);
    ParallelFor(count, context_.threads, [&](int i) {
      statuses[i] = context_.stop.stop_requested() ? absl::CancelledError("stopped on request") : body(i);
    });
    for (absl::Status& status : statuses) RETURN_IF_ERROR(std::move(status));
    return absl::OkStatus();
  }

  int threads() const { return context_.threads; }
  bool want_motion() const { return context_.want_motion; }

  IntervalSummary Complete(int frames) {
    summary_.termination = "complete";
    summary_.frames = frames;
    return std::move(summary_);
  }

 private:
  const RunContext& context_;
  IntervalSummary summary_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_STAGE_RUNNER_H_
