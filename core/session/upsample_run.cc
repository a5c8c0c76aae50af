#include "core/session/upsample_run.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core/version.hpp>
#include <optional>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/io/file.h"
#include "core/session/scene_flow_files.h"
#include "core/session/write_queue.h"

namespace depthtween {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

// Parses `text` and hands the value to `read`, turning what nlohmann throws at a wrong type into a status that names
// `what`.
template <typename Read>
auto ParseJson(std::string_view text, const char* what, Read read) -> decltype(read(json())) {
  try {
    const json value = json::parse(text);
    if (!value.is_object()) return absl::InvalidArgumentError(absl::StrCat(what, ": must be a JSON object"));
    return read(value);
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(what, ": ", error.what()));
  }
}

json IntervalToJson(const Interval& interval) {
  return {{"index", interval.index},
          {"first_frame", interval.first_frame},
          {"frame_count", interval.frame_count},
          {"held", interval.Held()}};
}

// Frames before the first or after the last depth frame are held. A few are usual, since streams end at different
// moments; more than a period of depth, or a good part of the clip, is worth a word.
std::optional<std::string> HeldFramesWarning(const Sequence& sequence, const std::vector<Interval>& intervals) {
  constexpr double kUsualShare = 0.25, kUsualPeriods = 1.05;
  if (sequence.depth.size() < 2) return std::nullopt;
  int before = 0, after = 0;
  for (const Interval& interval : intervals) {
    if (interval.key_before < 0) before += interval.frame_count;
    if (interval.key_after < 0) after += interval.frame_count;
  }
  const auto& color = sequence.color;
  const auto& depth = sequence.depth;
  const double usual_ns = kUsualPeriods * static_cast<double>(MedianPeriodNs(depth));
  const auto wait_ns =
      std::max(depth.front().time_ns - color.front().time_ns, color.back().time_ns - depth.back().time_ns);
  const auto total = static_cast<double>(color.size());
  if (before + after == 0 || (before + after <= kUsualShare * total && static_cast<double>(wait_ns) <= usual_ns))
    return std::nullopt;
  return absl::StrFormat(
      "%d of %d frames are held, which means that they show a depth frame unchanged (provenance 5): %d before the "
      "first depth frame and %d after the last, since colour runs from %s to %s s and depth from %s to %s s. If both "
      "cameras "
      "ran at once, their clocks differ: see --clock (options.clock); else cut colour to the time of depth",
      before + after, color.size(), before, after, FormatSeconds(color.front().time_ns),
      FormatSeconds(color.back().time_ns), FormatSeconds(depth.front().time_ns), FormatSeconds(depth.back().time_ns));
}

// Depth that lies beside colour is the commonest fault of recordings: said whether or not it is corrected.
std::optional<std::string> RegistrationWarning(const ClipAlignment& alignment, std::string_view choice) {
  if (!alignment.registered.has_value()) return std::nullopt;
  const std::string summary = Summary(*alignment.registered);
  if (alignment.registered->IsOff())
    return alignment.registration.IsIdentity()
               ? absl::StrCat(summary,
                              ". Depth is taken as it lies, so it is wrong beside every edge: --register estimate "
                              "(options.register) moves it to colour. Clocks may differ too: --clock estimate "
                              "(options.clock) measures them")
               : absl::StrCat(summary, ". Depth was moved so");
  if (alignment.registered->edges > 0 && !alignment.registered->reason.empty())
    return absl::StrCat(summary, "; depth is taken as it lies");
  return std::nullopt;
}

}  // namespace

absl::StatusOr<ClipPlan> PrepareClip(const FrameSource& recording, const UpsampleOptions& options, std::stop_token stop,
                                     const std::function<void(int, int)>& on_clock) {
  RETURN_IF_ERROR(Validate(recording.sequence()));
  ClipPlan plan;
  ASSIGN_OR_RETURN(const ClockChoice choice, ParseClockChoice(options.clock));
  ClipClock& clock = plan.alignment.clock;
  ASSIGN_OR_RETURN(clock, DecideClock(recording, choice, options.threads, stop, on_clock));
  const Sequence input = InputOf(recording.sequence(), clock, options.key_every);
  const std::string with_clock = absl::StrCat("with options.clock = ", options.clock);
  RETURN_IF_ERROR(WithContext(Validate(input), with_clock));
  const double applied_ms = clock.color_per_depth > 0 ? 0.0 : 1e-6 * clock.model.offset_ns;
  RETURN_IF_ERROR(WithContext(CheckOverlap(input, applied_ms), with_clock));
  RETURN_IF_ERROR(DecideRegistration(recording, options.registration, options.key_every, options.threads,
                                     std::move(stop), plan.alignment));
  const ClipSource source(recording, plan.alignment, options.key_every);
  ASSIGN_OR_RETURN(plan.constants, EstimateClipConstants(source, options.causal));
  const std::vector<std::string> reading = recording.Warnings(options.threads);
  plan.constants.warnings.insert(plan.constants.warnings.begin(), reading.begin(), reading.end());
  if (clock.estimate.has_value() && !clock.estimate->reason.empty())
    plan.constants.warnings.push_back(absl::StrCat(
        Summary(*clock.estimate),
        clock.model.offset_ns == 0.0
            ? "; the stamps are kept"
            : absl::StrFormat("; the streams do not overlap, and that their first frames were taken at once (the depth "
                              "clock ahead by %.3f ms) is a guess: --clock=OFFSET_MS says it",
                              1e-6 * clock.model.offset_ns)));
  if (auto warning = RegistrationWarning(plan.alignment, options.registration))
    plan.constants.warnings.push_back(*std::move(warning));
  plan.intervals = PlanIntervals(source.sequence());
  if (auto warning = HeldFramesWarning(source.sequence(), plan.intervals))
    plan.constants.warnings.push_back(*std::move(warning));
  if (source.sequence().depth.size() == 1)
    plan.constants.warnings.push_back(
        "only one depth frame is input, so every frame holds it: a smaller key_every keeps more");
  return plan;
}

json ToJson(const ClipConstants& constants) {
  return {{"noise_a_m", constants.noise_a_m},           {"noise_b_per_m", constants.noise_b_per_m},
          {"preview_near_m", constants.preview_near_m}, {"preview_far_m", constants.preview_far_m},
          {"median_depth_m", constants.median_depth_m}, {"warnings", constants.warnings}};
}

ClipConstants ConstantsFromJson(const json& constants) {
  return {.noise_a_m = constants.at("noise_a_m").get<double>(),
          .noise_b_per_m = constants.at("noise_b_per_m").get<double>(),
          .preview_near_m = constants.at("preview_near_m").get<double>(),
          .preview_far_m = constants.at("preview_far_m").get<double>(),
          .median_depth_m = constants.at("median_depth_m").get<double>(),
          .warnings = constants.at("warnings").get<std::vector<std::string>>()};
}

json ToJson(const ClipPlan& plan, const Sequence& recording) {
  json intervals = json::array();
  for (const Interval& interval : plan.intervals) intervals.push_back(IntervalToJson(interval));
  json frames = json::array();
  for (size_t i = 0; i < recording.color.size(); ++i)
    frames.push_back({{"index", i}, {"time_ns", recording.color[i].time_ns}, {"stem", recording.color[i].Stem()}});
  json value = {
      {"constants", ToJson(plan.constants)}, {"intervals", std::move(intervals)}, {"frames", std::move(frames)}};
  AddTo(plan.alignment, value);
  return value;
}

absl::StatusOr<ClipPlan> ParseClipPlan(std::string_view text, const Sequence& recording,
                                       const UpsampleOptions& options) {
  return ParseJson(text, "constants", [&](const json& value) -> absl::StatusOr<ClipPlan> {
    ClipPlan plan;
    plan.constants = ConstantsFromJson(value.at("constants"));
    plan.alignment = AlignmentOf(value);
    // Intervals follow from the recording and its clock; those in the file tell whether it belongs to this one.
    plan.intervals = PlanIntervals(InputOf(recording, plan.alignment.clock, options.key_every));
    json expected = json::array();
    for (const Interval& interval : plan.intervals) expected.push_back(IntervalToJson(interval));
    if (value.at("intervals") != expected)
      return absl::FailedPreconditionError(
          "constants: made for another sequence or another key_every: run prepare again");
    return plan;
  });
}

absl::Status CheckIntervals(size_t interval_count, int first, int count) {
  const int last = static_cast<int>(interval_count) - 1;
  if (first >= 0 && count >= 1 && first <= last && count <= last - first + 1) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "%d intervals from interval %d on are not there: this clip has intervals 0 to %d", count, first, last));
}

json ToJson(const IntervalReport& report) {
  return {{"interval", report.index},
          {"seconds", report.seconds},
          {"frames", report.summary.frames},
          {"motion_frames", report.motion_frames},
          {"termination", report.summary.termination},
          {"stages", report.summary.stage_seconds}};
}

absl::StatusOr<IntervalReport> ParseIntervalReport(std::string_view text) {
  return ParseJson(text, "interval report", [](const json& value) -> absl::StatusOr<IntervalReport> {
    return IntervalReport{.index = value.at("interval").get<int>(),
                          .seconds = value.at("seconds").get<double>(),
                          .summary = {.termination = value.at("termination").get<std::string>(),
                                      .frames = value.at("frames").get<int>(),
                                      .stage_seconds = value.at("stages").get<std::map<std::string, double>>()},
                          .motion_frames = value.at("motion_frames").get<int>()};
  });
}

absl::StatusOr<std::vector<IntervalReport>> RunIntervals(const Upsampler& upsampler, const FrameSource& source,
                                                         const ClipPlan& plan, int first, int count,
                                                         const UpsampleOptions& options, std::stop_token stop,
                                                         const ResultWriter& writer, RunObserver& observer) {
  RETURN_IF_ERROR(CheckIntervals(plan.intervals.size(), first, count));
  std::vector<IntervalReport> reports;
  for (int i = first; i < first + count; ++i) {
    const auto start = Clock::now();
    // Packing and syncing three PNGs takes a good part of the time that computing them does.
    WriteQueue queue(options.threads, [&](int frame) { observer.OnFrame(i, frame); });
    const RunContext context{.threads = options.threads,
                             .stop = stop,
                             .want_motion = options.NeedsMotion(),
                             .on_stage = [&](std::string_view stage) { observer.OnStage(i, stage); },
                             .on_item = [&] { observer.OnItem(); }};
    IntervalReport report{.index = i};
    const auto sink = [&](DepthResult result) -> absl::Status {
      if (stop.stop_requested()) return absl::CancelledError("stopped");
      const int frame = result.color_index;
      report.motion_frames += result.motion_next.empty() ? 0 : 1;
      return queue.Add(frame, [&writer, result = std::move(result)] { return writer.Write(result); });
    };
    ASSIGN_OR_RETURN(report.summary, upsampler.Run(source, plan.constants, plan.intervals[i], context, sink));
    const auto computed = Clock::now();
    RETURN_IF_ERROR(queue.Finish());
    report.summary.stage_seconds["write"] += SecondsSince(computed);
    report.seconds = SecondsSince(start);
    RETURN_IF_ERROR(observer.OnIntervalDone(report));
    reports.push_back(std::move(report));
  }
  return reports;
}

namespace {

// Scene flow takes a frame without motion for one that has none to give, so that what is lost would go unnoticed.
absl::Status CheckMotion(const std::string& dir, const Sequence& sequence, const ClipPlan& plan,
                         const std::vector<IntervalReport>& reports) {
  for (const IntervalReport& report : reports) {
    const Interval& interval = plan.intervals[report.index];
    int there = 0;
    for (int i = interval.first_frame; i < interval.first_frame + interval.frame_count; ++i)
      there += FileExists(JoinPath(dir, ResultMotionName(sequence.color[i].Stem()))) ? 1 : 0;
    if (there < report.motion_frames)
      return absl::DataLossError(absl::StrFormat(
          "interval %d: the motion of %d frames was written, and that of %d is there: the other files are "
          "lost, compute the clip again",
          report.index, report.motion_frames, there));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status AssembleResult(const UpsampleOptions& options, const std::string& sequence_dir, const Sequence& sequence,
                            const ClipPlan& plan, const std::vector<IntervalReport>& reports, json renders,
                            json self_check, const ResultWriter& writer, const AssemblyContext& context) {
  std::vector<bool> seen(plan.intervals.size(), false);
  double seconds = 0.0;
  int frames = 0, held_frames = 0;
  std::map<std::string, double> stages;
  std::map<std::string, int> terminations;
  for (const IntervalReport& report : reports) {
    if (report.index < 0 || report.index >= static_cast<int>(seen.size()) || seen[report.index])
      return absl::FailedPreconditionError(
          absl::StrFormat("interval %d is reported but not part of the clip, or reported twice", report.index));
    seen[report.index] = true;
    seconds += report.seconds;
    frames += report.summary.frames;
    if (plan.intervals[report.index].Held()) held_frames += report.summary.frames;
    for (const auto& [stage, stage_seconds] : report.summary.stage_seconds) stages[stage] += stage_seconds;
    ++terminations[report.summary.termination];
  }
  const auto missing = std::find(seen.begin(), seen.end(), false);
  if (missing != seen.end())
    return absl::FailedPreconditionError(
        absl::StrFormat("interval %d has not been computed: run it first", missing - seen.begin()));
  json report = {{"sequence", sequence_dir.empty() ? json() : json(sequence_dir)},
                 {"options", ToJson(options)},
                 {"frames", frames},
                 {"held_frames", held_frames},
                 {"keys", sequence.depth.size()},
                 {"intervals", plan.intervals.size()},
                 {"terminations", terminations},
                 {"seconds", seconds},
                 {"stages", stages},
                 {"renders", std::move(renders)},
                 {"constants", ToJson(plan.constants)},
                 {"warnings", plan.constants.warnings},
                 {"versions", {{"depthtween", DEPTHTWEEN_VERSION}, {"opencv", CV_VERSION}, {"compiler", __VERSION__}}}};
  AddTo(plan.alignment, report);
  if (options.scene_flow) {
    RETURN_IF_ERROR(CheckMotion(writer.dir(), sequence, plan, reports));
    ASSIGN_OR_RETURN(report["scene_flow_frames"], AddSceneFlow(writer.dir(), sequence, plan.constants, options.threads,
                                                               context.stop, context.on_scene_flow));
  }
  if (!self_check.is_null()) report["self_check"] = std::move(self_check);
  return writer.Finish(report);
}

}  // namespace depthtween
