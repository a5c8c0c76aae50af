#include "core/session/self_check.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/api/make_upsampler.h"
#include "core/baselines/baselines.h"
#include "core/sequence/sequence.h"
#include "core/session/clip_scoring.h"
#include "core/session/clip_truth.h"

namespace depthtween {
namespace {

// From the strongest to the weakest, as people are told.
constexpr const char* kCompared[] = {"flow-warp", "linear", "hold"};

// `count` of `frames`, each in the middle of an equal share of them.
std::vector<int> Spread(const std::vector<int>& frames, int count) {
  const size_t total = frames.size();
  std::vector<int> chosen;
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) chosen.push_back(frames[(2 * i + 1) * total / (2 * count)]);
  return chosen;
}

std::vector<SelfCheck::Frame> WorstFrames(const ComparisonScore& score, const Sequence& sequence) {
  std::vector<SelfCheck::Frame> frames;
  for (const FrameScore& frame : score.frames) {
    if (frame.pixels == 0) continue;
    const FrameRef& color = sequence.color[frame.color_index];
    frames.push_back({frame.color_index, color.Stem(), color.time_ns, frame.rmse_mm[0]});
  }
  std::stable_sort(frames.begin(), frames.end(), [](const auto& a, const auto& b) { return a.rmse_mm > b.rmse_mm; });
  if (frames.size() > kWorstFramesTold) frames.resize(kWorstFramesTold);
  return frames;
}

SelfCheck::Method MethodOf(const MethodScore& score) {
  SelfCheck::Method method{.name = score.name,
                           .rmse_mm = score[Region::kAll].rmse_mm,
                           .mae_mm = score[Region::kAll].mae_mm,
                           .completeness = score.completeness};
  if (score[Region::kEdgeBand].pixels > 0) method.edge_band_rmse_mm = score[Region::kEdgeBand].rmse_mm;
  if (score.uncertainty.pixels > 0)
    for (const auto& at : score.uncertainty.coverage)
      if (at.k == 1.0) method.within_one_sigma = at.share;
  return method;
}

std::string Millimetres(double value) { return absl::StrFormat("%.1f", value); }

// All but the summary.
absl::StatusOr<SelfCheck> Measure(const SequenceFolder& recording, const UpsampleOptions& options, std::stop_token stop,
                                  const std::function<void(int, int)>& on_map, const std::function<void()>& on_item) {
  const auto start = std::chrono::steady_clock::now();
  ASSIGN_OR_RETURN(const std::unique_ptr<Upsampler> ours, MakeUpsampler(options));
  const int keys = (static_cast<int>(recording.sequence().depth.size()) - 1) / options.key_every + 1;
  if (keys < 3)
    return SelfCheck{
        .reason = absl::StrFormat("%d depth frames are input, and it takes 3 to hold one out between two", keys)};
  UpsampleOptions halved = options;
  halved.key_every = 2 * options.key_every;
  ASSIGN_OR_RETURN(const ClipPlan plan, PrepareClip(recording, halved, stop, [&](int, int) {
                     if (on_item) on_item();
                   }));
  absl::StatusOr<ClipTruth> truth =
      ClipTruth::Open(recording, plan.alignment, halved.key_every, ClipTruth::Kind::kLeftOutDepth);
  if (absl::IsFailedPrecondition(truth.status()))
    return SelfCheck{.reason = "no held-out depth frame is within 3 ms of a colour frame that could be compared"};
  RETURN_IF_ERROR(truth.status());

  // Depth maps that the upsampling itself does not take as input are no truth here either: the check would speak of
  // another gap.
  const Sequence sequence = ByStamps(recording.sequence(), plan.alignment.clock);
  std::map<int, int> depth_at;  // by colour frame
  for (int d = options.key_every; d < static_cast<int>(sequence.depth.size()); d += halved.key_every)
    depth_at[NearestColorFrame(sequence, sequence.depth[d].time_ns)] = d;
  truth->Keep([&](int color) { return depth_at.count(color) > 0; });
  const std::vector<int> frames = truth->Frames();
  if (frames.empty())
    return SelfCheck{.reason = "no held-out depth frame is within 3 ms of a colour frame that could be compared"};
  const std::vector<int> checked = Spread(frames, std::min<int>(kMaxMapsChecked, static_cast<int>(frames.size())));
  truth->Keep([&](int color) { return std::binary_search(checked.begin(), checked.end(), color); });
  std::vector<std::vector<int>> floor_runs;
  for (const int color : checked) floor_runs.push_back({depth_at[color] - 1, depth_at[color]});

  std::vector<ScoredMethod> methods = {{.name = options.method, .upsampler = ours.get(), .predicts_sigma = true}};
  std::vector<std::unique_ptr<Upsampler>> baselines;
  for (const char* name : kCompared) {
    ASSIGN_OR_RETURN(baselines.emplace_back(), MakeBaseline(name));
    methods.push_back({.name = name, .upsampler = baselines.back().get(), .any_frame = true});
  }
  ASSIGN_OR_RETURN(const ClipScores scores, ScoreMethods(recording, *std::move(truth), methods,
                                                         {.alignment = plan.alignment,
                                                          .key_every = halved.key_every,
                                                          .constants = plan.constants,
                                                          .threads = options.threads,
                                                          .stop = stop,
                                                          .floor_runs = std::move(floor_runs),
                                                          .on_frame = on_map,
                                                          .on_item = on_item}));
  if (scores.score.common_pixels == 0)
    return SelfCheck{.reason = "no pixel of the held-out depth frames is known and answered by all methods"};
  SelfCheck check{.maps_checked = static_cast<int>(checked.size()),
                  .maps_held_out = static_cast<int>(frames.size()),
                  .pixels = scores.score.common_pixels,
                  .worst_frames = WorstFrames(scores.score, sequence)};
  if (scores.sensor_floor)
    check.sensor_floor =
        SelfCheck::Floor{.rmse_mm = scores.sensor_floor->rmse_mm, .mae_mm = scores.sensor_floor->mae_mm};
  for (const MethodScore& method : scores.score.methods) check.methods.push_back(MethodOf(method));
  check.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return check;
}

}  // namespace

absl::StatusOr<SelfCheck> CheckSelf(const SequenceFolder& recording, const UpsampleOptions& options,
                                    std::stop_token stop, const std::function<void(int, int)>& on_map,
                                    const std::function<void()>& on_item) {
  ASSIGN_OR_RETURN(SelfCheck check, Measure(recording, options, std::move(stop), on_map, on_item));
  check.summary = Summary(check);
  return check;
}

std::string Summary(const SelfCheck& check) {
  if (!check.reason.empty()) return "no self-check: " + check.reason;
  std::string others;
  for (size_t m = 1; m < check.methods.size(); ++m)
    absl::StrAppend(&others, m == 1 ? "" : ", ", check.methods[m].name, " ", Millimetres(check.methods[m].rmse_mm));
  std::string text = absl::StrFormat("on your clip, at half the depth rate, %s errs by %s mm RMSE (%s)",
                                     check.methods[0].name, Millimetres(check.methods[0].rmse_mm), others);
  if (!check.worst_frames.empty()) absl::StrAppend(&text, "; worst at frame ", check.worst_frames[0].stem);
  if (check.sensor_floor)
    absl::StrAppend(&text, "; the sensor differs from itself by ", Millimetres(check.sensor_floor->rmse_mm),
                    " mm where nothing moves");
  return text + "; the result is better than that, since its gaps are half as wide";
}

std::string FormatTable(const SelfCheck& check) {
  std::string text = check.summary + "\n";
  if (!check.reason.empty()) return text;
  absl::StrAppendFormat(&text, "\n%-10s  %8s  %8s  %10s  %9s  %8s   (%d of %d held-out depth maps)\n", "self-check",
                        "RMSE mm", "MAE mm", "edge band", "complete", "<1 sigma", check.maps_checked,
                        check.maps_held_out);
  for (const SelfCheck::Method& method : check.methods)
    absl::StrAppendFormat(&text, "%-10s  %8s  %8s  %10s  %7.1f %%  %8s\n", method.name, Millimetres(method.rmse_mm),
                          Millimetres(method.mae_mm),
                          method.edge_band_rmse_mm ? Millimetres(*method.edge_band_rmse_mm) : "-",
                          100 * method.completeness,
                          method.within_one_sigma ? absl::StrFormat("%.1f %%", 100 * *method.within_one_sigma) : "-");
  absl::StrAppend(&text, "worst frames:");
  for (const SelfCheck::Frame& frame : check.worst_frames)
    absl::StrAppendFormat(&text, " %s (%s s, %s mm)", frame.stem, FormatSeconds(frame.time_ns),
                          Millimetres(frame.rmse_mm));
  return text + "\n";
}

}  // namespace depthtween
