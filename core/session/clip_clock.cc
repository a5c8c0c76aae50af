#include "core/session/clip_clock.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "core/sequence/retold_source.h"

namespace depthtween {

using nlohmann::json;

absl::StatusOr<ClockEstimate> EstimateAnyClock(const FrameSource& recording, const SynchroniseOptions& options) {
  const Sequence& sequence = recording.sequence();
  if (CheckOverlap(sequence).ok()) return EstimateClock(recording, options);
  const ClockModel apart{.offset_ns = static_cast<double>(sequence.depth.front().time_ns) -
                                      static_cast<double>(sequence.color.front().time_ns)};
  RETURN_IF_ERROR(apart.Validate());
  Sequence together = sequence;
  for (FrameRef& frame : together.depth)
    frame.time_ns -= sequence.depth.front().time_ns - sequence.color.front().time_ns;
  ASSIGN_OR_RETURN(ClockEstimate estimate, EstimateClock(RetoldSource(recording, std::move(together)), options));
  if (!estimate.reason.empty()) estimate.model = {.reference_ns = sequence.color.front().time_ns};
  estimate.model.offset_ns += apart.offset_ns;
  return estimate;
}

absl::StatusOr<ClipClock> DecideClock(const FrameSource& recording, const ClockChoice& choice, int threads,
                                      std::stop_token stop, const std::function<void(int, int)>& on_progress) {
  const Sequence& sequence = recording.sequence();
  ClipClock clock{.model = {.reference_ns = sequence.color.front().time_ns}};
  switch (choice.mode) {
    case ClockChoice::Mode::kStamps:
      break;
    case ClockChoice::Mode::kIndex:
      clock.color_per_depth = ColorFramesPerDepth(sequence);
      break;
    case ClockChoice::Mode::kEstimate: {
      ASSIGN_OR_RETURN(
          ClockEstimate estimate,
          EstimateAnyClock(recording, {.threads = threads, .stop = std::move(stop), .on_progress = on_progress}));
      if (estimate.reason.empty() || !CheckOverlap(sequence).ok()) clock.model = estimate.model;
      clock.estimate = std::move(estimate);
      break;
    }
    case ClockChoice::Mode::kGiven:
      clock.model.offset_ns = 1e6 * choice.offset_ms;
      clock.model.drift_ppm = choice.drift_ppm;
      break;
  }
  return clock;
}

json ToJson(const ClipClock& clock) {
  const ClockModel& model = clock.model;
  json value = {{"reference_ns", model.reference_ns},
                {"offset_ns", model.offset_ns},
                {"drift_ppm", model.drift_ppm},
                {"color_per_depth", clock.color_per_depth}};
  if (clock.estimate.has_value()) value["estimate"] = ToJson(*clock.estimate);
  return value;
}

ClipClock ClockOf(const json& plan_or_report) {
  const json& clock = plan_or_report.at("clock");
  return {.model = {.reference_ns = clock.at("reference_ns").get<int64_t>(),
                    .offset_ns = clock.at("offset_ns").get<double>(),
                    .drift_ppm = clock.at("drift_ppm").get<double>()},
          .color_per_depth = clock.at("color_per_depth").get<int>(),
          .estimate =
              clock.contains("estimate") ? std::optional(ClockEstimateFromJson(clock.at("estimate"))) : std::nullopt};
}

Sequence ByStamps(const Sequence& recording, const ClipClock& clock) {
  return PairDepthWithinJitter(CorrectDepthStamps(recording, clock.model));
}

Sequence InputOf(const Sequence& recording, const ClipClock& clock, int key_every) {
  return KeepEveryNthDepth(
      clock.color_per_depth > 0 ? PairDepthByIndex(recording, clock.color_per_depth) : ByStamps(recording, clock),
      key_every);
}

}  // namespace depthtween
