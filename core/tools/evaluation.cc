#include "core/tools/evaluation.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/baselines/baselines.h"
#include "core/baselines/frame_steps.h"
#include "core/io/file.h"
#include "core/io/flow_png.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/io/result_folder.h"
#include "core/io/sequence_folder.h"
#include "core/metrics/sensor_floor.h"
#include "core/sequence/interval.h"
#include "core/tools/clip_clock.h"

namespace depthtween::tools {
namespace {

using nlohmann::json;

constexpr double kStillCameraShare = 0.5;   // of pixels that nothing moves at, above which the camera stands still
constexpr int64_t kSameTimeNs = 3'000'000;  // a depth map may be scored at a colour frame this near in time

// One frame to score, and where its truth comes from.
struct TruthRef {
  int color = -1;
  int depth = -1;    // into the reference's depth maps, or -1:
  std::string path;  // gt/depth of this frame
};

struct TruthPlan {
  std::string kind;
  std::vector<TruthRef> frames;  // ascending, strictly between the first and the last key
  std::vector<std::string> notes;
};

bool AtTime(const FrameRef& frame, int64_t time_ns) { return std::abs(frame.time_ns - time_ns) <= kSameTimeNs; }

// Left-out depth maps are placed in time by the clock of the result. Pairing by index is no clock: where it says that a
// map belongs is what is to be judged, so the stamps place it.
absl::StatusOr<TruthPlan> PlanTruth(const SequenceFolder& reference, const ClockModel& clock, int key_every) {
  const Sequence sequence = CorrectDepthStamps(reference.sequence(), clock);
  const Sequence keys = KeepEveryNthDepth(sequence, key_every);
  const int64_t first_ns = keys.depth.front().time_ns, last_ns = keys.depth.back().time_ns;
  const auto between_keys = [&](int64_t time_ns) { return time_ns > first_ns && time_ns < last_ns; };

  TruthPlan plan{.kind = "gt/depth"};
  for (size_t c = 0; c < sequence.color.size(); ++c) {
    if (!between_keys(sequence.color[c].time_ns)) continue;
    if (auto path = GroundTruthDepthPath(reference.dir(), sequence.color[c].Stem()))
      plan.frames.push_back({.color = static_cast<int>(c), .path = *std::move(path)});
  }
  if (!plan.frames.empty()) return plan;

  plan.kind = "left-out depth maps";
  if (key_every == 1)
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s has no gt/depth between its first and last depth map, and all its depth maps were input, so there is no "
        "truth to score: run upsample with --key-every 2 or more and evaluate that result",
        reference.dir()));
  int left_out = 0;
  for (size_t d = 0; d < sequence.depth.size(); ++d) {
    const int64_t time_ns = sequence.depth[d].time_ns;
    if (d % key_every == 0 || !between_keys(time_ns)) continue;
    ++left_out;
    const int color = NearestColorFrame(sequence, time_ns);
    if (AtTime(sequence.color[color], time_ns) && between_keys(sequence.color[color].time_ns))
      plan.frames.push_back({.color = color, .depth = static_cast<int>(d)});
  }
  const int unmatched = left_out - static_cast<int>(plan.frames.size());
  if (plan.frames.empty())
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s: none of its %d left-out depth maps is within 3 ms of a colour frame, so there is no truth to score: use a "
        "recording whose colour and depth stamps meet, or another --key-every",
        reference.dir(), left_out));
  if (unmatched > 0)
    plan.notes.push_back(absl::StrFormat("%d of %d left-out depth maps are not scored: no colour frame within 3 ms",
                                         unmatched, left_out));
  return plan;
}

// Result frame of each colour frame of the reference, by time stamp; -1 where there is none.
absl::StatusOr<std::vector<int>> MatchFrames(const ResultFolder& result, const SequenceFolder& reference) {
  const Sequence& sequence = reference.sequence();
  if (result.camera().width != sequence.camera.width || result.camera().height != sequence.camera.height)
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s is %d x %d, %s %d x %d, must be the same: name the sequence that the result was made from", result.dir(),
        result.camera().width, result.camera().height, reference.dir(), sequence.camera.width, sequence.camera.height));
  std::map<int64_t, int> by_time;
  for (size_t i = 0; i < result.frames().size(); ++i) by_time[result.frames()[i].time_ns] = static_cast<int>(i);
  std::vector<int> matches;
  for (const FrameRef& frame : sequence.color) {
    const auto found = by_time.find(frame.time_ns);
    matches.push_back(found == by_time.end() ? -1 : found->second);
  }
  if (std::all_of(matches.begin(), matches.end(), [](int match) { return match < 0; }))
    return absl::InvalidArgumentError(
        absl::StrFormat("no frame of %s has the time stamp of a colour frame of %s: name the sequence that the result "
                        "was made from",
                        result.dir(), reference.dir()));
  return matches;
}

absl::StatusOr<ResultFolder> OpenResult(const std::string& dir) {
  auto result = ResultFolder::Open(dir);
  if (result.ok()) return result;
  return absl::Status(result.status().code(),
                      absl::StrCat(result.status().message(),
                                   ": name a folder that `depthtween-core upsample SEQ -o OUT` has finished"));
}

struct ResultFacts {
  std::string method;
  int key_every = 1;
  ClipClock clock;
};

absl::StatusOr<ResultFacts> ReadFacts(const ResultFolder& result) {
  const json options = result.report().value("options", json::object());
  const auto method = options.find("method"), key_every = options.find("key_every");
  if (method == options.end() || !method->is_string() || key_every == options.end() ||
      !key_every->is_number_integer() || key_every->get<int64_t>() < 1 || key_every->get<int64_t>() > 1'000'000)
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s/report.json does not say options.method and options.key_every: evaluate a folder that upsample wrote",
        result.dir()));
  ResultFacts facts{.method = method->get<std::string>(), .key_every = key_every->get<int>()};
  try {
    facts.clock = ClockOf(result.report());
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(result.dir(), "/report.json: clock: ", error.what()));
  }
  return facts;
}

// True motion, frame by frame, where the reference has it: gt/flow, gt/occ.
class MotionTruth {
 public:
  explicit MotionTruth(std::string reference_dir) : dir_(std::move(reference_dir)) {}

  // Goes on to the colour frame of this stem; frames in time order.
  absl::Status Advance(const std::string& stem, bool at_key_time, int width, int height) {
    const bool followed = !flow_.flow.empty() && !hidden_.empty();
    if (at_key_time)
      visibility_.Restart(width, height);
    else if (visibility_.Started() && followed)
      visibility_.Advance(Motion());
    else
      visibility_ = KeyVisibility();
    flow_ = {};
    hidden_ = {};
    const std::string flow_path = JoinPath(dir_, "gt/flow/" + stem + ".png");
    const std::string hidden_path = JoinPath(dir_, "gt/occ/" + stem + ".png");
    if (FileExists(flow_path)) {
      ASSIGN_OR_RETURN(flow_, ReadFlowPng(flow_path));
    }
    if (FileExists(hidden_path)) {
      ASSIGN_OR_RETURN(hidden_, ReadPng8(hidden_path));
    }
    const auto fits = [&](const auto& image) {
      return image.empty() || (image.width() == width && image.height() == height);
    };
    if (!fits(flow_.flow) || !fits(hidden_))
      return absl::InvalidArgumentError(absl::StrFormat("%s or %s is not %d x %d, must be as the camera says",
                                                        flow_path, hidden_path, width, height));
    unseen_ = visibility_.Started() ? visibility_.Unseen() : Image<uint8_t>();
    return absl::OkStatus();
  }

  TrueMotion Motion() const {
    return {.flow_px = flow_.flow.view(), .valid = flow_.valid.view(), .hidden_in_next = hidden_.view()};
  }
  const Image<uint8_t>& Unseen() const { return unseen_; }

 private:
  const std::string dir_;
  FlowField flow_;  // of the current frame, to the next
  Image<uint8_t> hidden_, unseen_;
  KeyVisibility visibility_;
};

// One frame by one baseline, stored and read back as every result is.
absl::StatusOr<Image<float>> RunBaseline(const Upsampler& baseline, const FrameSource& keys, const Interval& interval,
                                         int color, const EvaluationOptions& options) {
  Interval frame = interval;
  frame.first_frame = color;
  frame.frame_count = 1;
  Image<float> depth_m;
  const RunContext context{.threads = options.threads, .stop = options.stop};
  const double depth_scale = keys.sequence().depth_scale;
  const auto run = baseline.Run(keys, ClipConstants{}, frame, context, [&](DepthResult result) {
    depth_m = DequantiseDepth(QuantiseDepth(result.depth_m, depth_scale), depth_scale);
    return absl::OkStatus();
  });
  if (!run.ok()) return WithContext(run.status(), baseline.name());
  return depth_m;
}

// None when the camera moves.
absl::StatusOr<std::optional<DepthScore>> MeasureSensorFloor(const SequenceFolder& reference,
                                                             const std::stop_token& stop) {
  const Sequence& sequence = reference.sequence();
  SensorFloor floor;
  for (size_t d = 0; d < sequence.depth.size(); ++d) {
    if (stop.stop_requested()) return absl::CancelledError("stopped on request");
    ASSIGN_OR_RETURN(const Image<float> depth_m, reference.Depth(static_cast<int>(d)));
    ASSIGN_OR_RETURN(const Image<Rgb8> color, reference.Color(NearestColorFrame(sequence, sequence.depth[d].time_ns)));
    RETURN_IF_ERROR(floor.Add(color, depth_m));
  }
  if (floor.StillShare() < kStillCameraShare) return std::nullopt;
  return floor.Score();
}

}  // namespace

absl::StatusOr<Evaluation> Evaluate(const EvaluationOptions& options) {
  ASSIGN_OR_RETURN(const ResultFolder result, OpenResult(options.result_dir));
  ASSIGN_OR_RETURN(const ResultFacts facts, ReadFacts(result));
  ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> reference, SequenceFolder::Open(options.reference_dir));
  ASSIGN_OR_RETURN(const std::vector<int> matches, MatchFrames(result, *reference));
  ASSIGN_OR_RETURN(TruthPlan plan, PlanTruth(*reference, facts.clock.model, facts.key_every));
  const auto in_result = [&](const TruthRef& truth) { return matches[truth.color] >= 0; };
  const auto kept = std::stable_partition(plan.frames.begin(), plan.frames.end(), in_result);
  if (const auto missing = plan.frames.end() - kept; missing > 0)
    plan.notes.push_back(absl::StrFormat("%d frames with truth are not scored: they are not in the result", missing));
  plan.frames.erase(kept, plan.frames.end());
  if (plan.frames.empty())
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s has no frame that %s has truth for: run upsample on all of it", options.result_dir, options.reference_dir));

  std::vector<std::string> names = {facts.method};
  std::vector<std::unique_ptr<Upsampler>> baselines;
  for (const std::string& name : options.baselines) {
    ASSIGN_OR_RETURN(std::unique_ptr<Upsampler> baseline, MakeBaseline(name));
    if (std::find(names.begin(), names.end(), name) != names.end()) continue;
    names.push_back(name);
    baselines.push_back(std::move(baseline));
  }

  const ClipSource keys(*reference, facts.clock, facts.key_every);
  const Sequence& sequence = keys.sequence();
  const std::vector<Interval> intervals = PlanIntervals(sequence);
  const auto interval_of = [&](int color) {
    return *(std::upper_bound(intervals.begin(), intervals.end(), color,
                              [](int frame, const Interval& interval) { return frame < interval.first_frame; }) -
             1);
  };
  std::vector<bool> at_key_time(sequence.color.size(), false);
  for (const FrameRef& key : sequence.depth) {
    const int color = NearestColorFrame(sequence, key.time_ns);
    if (AtTime(sequence.color[color], key.time_ns)) at_key_time[color] = true;
  }

  Evaluation evaluation{.result_dir = options.result_dir,
                        .reference_dir = options.reference_dir,
                        .method = facts.method,
                        .key_every = facts.key_every,
                        .truth = plan.kind,
                        .notes = plan.notes};
  Comparison comparison(names);
  MotionTruth motion(options.reference_dir);
  const int total = static_cast<int>(plan.frames.size());
  int done = 0;
  for (int color = 0; done < total; ++color) {
    if (options.stop.stop_requested()) return absl::CancelledError("stopped on request");
    const std::string stem = sequence.color[color].Stem();
    RETURN_IF_ERROR(motion.Advance(stem, at_key_time[color], sequence.camera.width, sequence.camera.height));
    const TruthRef& truth = plan.frames[done];
    if (truth.color != color) continue;
    if (options.on_progress) options.on_progress(done, total);

    Image<float> truth_m;
    if (truth.depth >= 0) {
      ASSIGN_OR_RETURN(truth_m, reference->Depth(truth.depth));
    } else {
      ASSIGN_OR_RETURN(const Image<uint16_t> units, ReadPng16(truth.path));
      truth_m = DequantiseDepth(units, sequence.depth_scale);
    }
    ASSIGN_OR_RETURN(const Image<float> ours_m, result.Depth(matches[color]));
    ASSIGN_OR_RETURN(const Image<float> sigma_m, result.Sigma(matches[color]));
    std::vector<Image<float>> theirs_m;
    for (const auto& baseline : baselines) {
      ASSIGN_OR_RETURN(Image<float> depth_m, RunBaseline(*baseline, keys, interval_of(color), color, options));
      theirs_m.push_back(std::move(depth_m));
    }

    std::vector<MethodFrame> methods = {{.depth_m = ours_m, .sigma_m = sigma_m}};
    for (const Image<float>& depth_m : theirs_m) methods.push_back({.depth_m = depth_m});
    RETURN_IF_ERROR(WithContext(
        comparison.AddFrame(
            {.color_index = color, .depth_m = truth_m, .motion = motion.Motion(), .unseen = motion.Unseen()}, methods),
        stem));
    evaluation.frame_stems.push_back(stem);
    ++done;
  }
  evaluation.score = comparison.Score();
  if (plan.frames.front().depth >= 0) {
    ASSIGN_OR_RETURN(evaluation.sensor_floor, MeasureSensorFloor(*reference, options.stop));
  }
  return evaluation;
}

}  // namespace depthtween::tools
