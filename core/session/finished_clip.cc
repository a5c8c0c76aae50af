#include "core/session/finished_clip.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/session/upsample_run.h"

namespace depthtween {

absl::StatusOr<FinishedClip> OpenFinishedClip(const std::string& result_dir, const std::string& sequence) {
  ASSIGN_OR_RETURN(ResultFolder result, ResultFolder::Open(result_dir));
  std::string sequence_dir = sequence;
  ClipConstants constants;
  UpsampleOptions options;
  ClipClock clock;
  try {
    const nlohmann::json& report = result.report();
    const nlohmann::json& made_from = report.at("sequence");
    if (sequence_dir.empty() && made_from.is_null())
      return absl::InvalidArgumentError(absl::StrCat(
          result_dir, " was made by a server and does not say where the recording is: name it with --sequence"));
    if (sequence_dir.empty()) sequence_dir = made_from.get<std::string>();
    constants = ConstantsFromJson(report.at("constants"));
    clock = ClockOf(report);
    ASSIGN_OR_RETURN(options, ParseUpsampleOptions(report.at("options")));
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(result_dir, "/report.json: ", error.what()));
  }
  if (!(constants.preview_near_m > 0 && constants.preview_near_m < constants.preview_far_m))
    return absl::InvalidArgumentError(
        absl::StrFormat("%s/report.json: preview range %g to %g m, must be positive and ascending", result_dir,
                        constants.preview_near_m, constants.preview_far_m));
  auto recording = SequenceFolder::Open(sequence_dir);
  if (!recording.ok())
    return WithContext(recording.status(), "the recording with the colour frames (name it with --sequence)");
  Sequence input = InputOf((*recording)->sequence(), clock, options.key_every);
  const auto same = [](const FrameRef& a, const FrameRef& b) { return a.time_ns == b.time_ns && a.Stem() == b.Stem(); };
  if (!std::equal(input.color.begin(), input.color.end(), result.frames().begin(), result.frames().end(), same))
    return absl::InvalidArgumentError(
        absl::StrFormat("%s was not made from the recording %s: name it with --sequence", result_dir, sequence_dir));
  return FinishedClip{std::move(result), *std::move(recording), std::move(input), std::move(constants)};
}

}  // namespace depthtween
