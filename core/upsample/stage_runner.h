// The stages of one interval, of any method: each is timed and announced, and stops between items when the caller asks
// to.
//
// Threads: one StageRunner belongs to one thread; SideBySide calls its body from several.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_STAGE_RUNNER_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_STAGE_RUNNER_H_

#include <chrono>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/base/status.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

class StageRunner {
 public:
  // Borrows `context`.
  explicit StageRunner(const RunContext& context) : context_(context) {}

  // Ends the stage before and begins another; its wall seconds are added to the summary under its name.
  void Begin(std::string_view stage) {
    End();
    if (context_.on_stage) context_.on_stage(stage);
    stage_ = stage;
    began_ = std::chrono::steady_clock::now();
  }
  void End() {
    if (stage_.empty()) return;
    summary_.stage_seconds[stage_] += std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
    stage_.clear();
  }

  // Body: absl::Status() or absl::StatusOr<T>(), which is returned.
  template <typename Body>
  auto Stage(std::string_view name, const Body& body) -> decltype(body()) {
    RETURN_IF_ERROR(CheckStop());
    Begin(name);
    auto made = body();
    End();
    return made;
  }

  // Cancelled once the caller has asked to stop.
  absl::Status CheckStop() const {
    return context_.stop.stop_requested() ? absl::CancelledError("stopped on request") : absl::OkStatus();
  }

  // Body: absl::Status(int). Runs body(i) for count items side by side and returns the first error in item order.
  template <typename Body>
  absl::Status SideBySide(int count, const Body& body) const {
    std::vector<absl::Status> statuses(count);
    ParallelFor(count, context_.threads, [&](int i) {
      statuses[i] = CheckStop();
      if (statuses[i].ok()) statuses[i] = body(i);
      if (context_.on_item) context_.on_item();
    });
    for (absl::Status& status : statuses) RETURN_IF_ERROR(std::move(status));
    return absl::OkStatus();
  }

  int threads() const { return context_.threads; }
  bool want_motion() const { return context_.want_motion; }

  // Of a run that came to its end.
  IntervalSummary Complete(int frames) {
    End();
    summary_.termination = "complete";
    summary_.frames = frames;
    return std::move(summary_);
  }

 private:
  const RunContext& context_;
  std::string stage_;  // empty between stages
  std::chrono::steady_clock::time_point began_;
  IntervalSummary summary_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_STAGE_RUNNER_H_
