// Any bytes as what a child says or leaves behind: refused, or values within the rules of the protocol.
#include "server/jobs/task_protocol.h"

#include <cstdlib>

using namespace depthtween::server;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const ProgressLine line = ParseProgressLine(text);
  if (line.stage.has_value() + line.interval_done.has_value() + line.checked.has_value() + line.error.has_value() > 1) {
    std::abort();
  }
  if ((line.error && line.error->ok()) || (line.lost && !line.error)) std::abort();
  ParseMotionFrames(text).status().IgnoreError();
  ParseValidation(text).status().IgnoreError();
  ReadSelfCheck(text).status().IgnoreError();
  if (const auto plan = ParsePlan(text); plan.ok()) {
    size_t frames = 0;
    for (const PlannedInterval& interval : plan->intervals) frames += static_cast<size_t>(interval.frame_count);
    if (plan->intervals.empty() || frames != plan->frames.size()) std::abort();
  }
  if (const auto renders = ParseRenderPlans(text, std::vector<RenderRecord>(1)); renders.ok()) {
    if (renders->size() != 1) std::abort();
  }
  return 0;
}
