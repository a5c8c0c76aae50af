#include "core/tools/clip_clock.h"

#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

namespace depthtween::tools {

using nlohmann::json;

absl::StatusOr<ClockChoice> ParseClockChoice(std::string_view text) {
  if (text == "stamps") return ClockChoice{};
  if (text == "index") return ClockChoice{.mode = ClockChoice::Mode::kIndex};
  ClockChoice choice{.mode = ClockChoice::Mode::kGiven};
  const std::vector<std::string> numbers = absl::StrSplit(absl::string_view(text.data(), text.size()), ',');
  if (numbers.size() > 2 || !absl::SimpleAtod(numbers[0], &choice.offset_ms) ||
      (numbers.size() == 2 && !absl::SimpleAtod(numbers[1], &choice.drift_ppm)))
    return absl::InvalidArgumentError(absl::StrFormat(
        "'%s', must be stamps, index, or OFFSET_MS[,DRIFT_PPM] such as 4 or 4,3000", std::string(text.substr(0, 64))));
  RETURN_IF_ERROR(ClockModel({.offset_ns = 1e6 * choice.offset_ms, .drift_ppm = choice.drift_ppm}).Validate());
  return choice;
}

json ToJson(const ClipClock& clock) {
  const ClockModel& model = clock.model;
  return {{"reference_ns", model.reference_ns},
          {"offset_ns", model.offset_ns},
          {"drift_ppm", model.drift_ppm},
          {"color_per_depth", clock.color_per_depth}};
}

ClipClock ClockOf(const json& plan_or_report) {
  if (!plan_or_report.contains("clock")) return {};
  const json& clock = plan_or_report.at("clock");
  return {.model = {.reference_ns = clock.at("reference_ns").get<int64_t>(),
                    .offset_ns = clock.at("offset_ns").get<double>(),
                    .drift_ppm = clock.at("drift_ppm").get<double>()},
          .color_per_depth = clock.at("color_per_depth").get<int>()};
}

Sequence InputOf(const Sequence& recording, const ClipClock& clock, int key_every) {
  if (clock.color_per_depth > 0)
    return KeepEveryNthDepth(PairDepthByIndex(recording, clock.color_per_depth), key_every);
  return KeepEveryNthDepth(CorrectDepthStamps(recording, clock.model), key_every);
}

}  // namespace depthtween::tools
