#include "core/session/clip_scoring.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "core/baselines/frame_steps.h"
#include "core/io/quantise.h"
#include "core/metrics/sensor_floor.h"
#include "core/sequence/interval.h"
#include "core/sequence/sequence.h"

namespace depthtween {
namespace {

constexpr double kStillCameraShare = 0.5;  // of pixels that nothing moves at, above which the camera stands still

// Frames that are run and scored together: all of one interval, or one.
struct Batch {
  Interval interval;
  std::vector<int> frames;  // colour indices, ascending
};

std::vector<Batch> PlanBatches(const Sequence& keys, const std::vector<int>& frames, bool one_by_one) {
  std::vector<Batch> batches;
  size_t next = 0;
  for (const Interval& interval : PlanIntervals(keys)) {
    const int end = interval.first_frame + interval.frame_count;
    for (bool first = true; next < frames.size() && frames[next] < end; ++next, first = one_by_one) {
      if (first) batches.push_back({.interval = interval});
      batches.back().frames.push_back(frames[next]);
    }
  }
  return batches;
}

// What one method says of each of `batch.frames`, as stored; frames without an answer stay empty.
absl::StatusOr<std::vector<DepthResult>> RunMethod(const ScoredMethod& method, const FrameSource& keys,
                                                   const Batch& batch, const ScoringOptions& options) {
  std::vector<DepthResult> results(batch.frames.size());
  const RunContext context{.threads = options.threads, .stop = options.stop, .on_item = options.on_item};
  const auto keep = [&](DepthResult result) {
    const auto found = std::lower_bound(batch.frames.begin(), batch.frames.end(), result.color_index);
    if (found == batch.frames.end() || *found != result.color_index) return absl::OkStatus();
    if (!method.predicts_sigma) result.sigma_m = {};
    result.provenance = {};
    results[found - batch.frames.begin()] = AsStored(std::move(result), keys.sequence().depth_scale);
    return absl::OkStatus();
  };
  if (!method.any_frame) {
    RETURN_IF_ERROR(WithContext(method.upsampler->Run(keys, options.constants, batch.interval, context, keep).status(),
                                method.name));
    return results;
  }
  for (const int frame : batch.frames) {
    Interval part = batch.interval;
    part.first_frame = frame;
    part.frame_count = 1;
    RETURN_IF_ERROR(
        WithContext(method.upsampler->Run(keys, options.constants, part, context, keep).status(), method.name));
  }
  return results;
}

// None when the camera moves.
absl::StatusOr<std::optional<DepthScore>> MeasureSensorFloor(const SequenceFolder& reference,
                                                             const std::vector<std::vector<int>>& runs, float far_m,
                                                             const std::stop_token& stop) {
  const Sequence& sequence = reference.sequence();
  SensorFloor floor(far_m);
  for (const std::vector<int>& run : runs) {
    floor.Restart();
    for (const int d : run) {
      if (stop.stop_requested()) return absl::CancelledError("stopped on request");
      ASSIGN_OR_RETURN(const Image<float> depth_m, reference.Depth(d));
      ASSIGN_OR_RETURN(const Image<Rgb8> color,
                       reference.Color(NearestColorFrame(sequence, sequence.depth[d].time_ns)));
      RETURN_IF_ERROR(floor.Add(color, depth_m));
    }
  }
  if (floor.StillShare() < kStillCameraShare) return std::nullopt;
  return floor.Score();
}

}  // namespace

DepthResult AsStored(DepthResult result, double depth_scale) {
  result.depth_m = DequantiseDepth(QuantiseDepth(result.depth_m, depth_scale), depth_scale);
  if (!result.sigma_m.empty())
    result.sigma_m = DequantiseSigma(QuantiseSigma(result.sigma_m, depth_scale), depth_scale);
  return result;
}

absl::StatusOr<ClipScores> ScoreMethods(const SequenceFolder& reference, ClipTruth truth,
                                        std::span<const ScoredMethod> methods, const ScoringOptions& options) {
  const ClipSource keys(reference, options.alignment, options.key_every);
  const Sequence& sequence = keys.sequence();
  const bool one_by_one =
      std::all_of(methods.begin(), methods.end(), [](const ScoredMethod& method) { return method.any_frame; });
  const std::vector<int> frames = truth.Frames();

  std::vector<std::string> names;
  for (const ScoredMethod& method : methods) names.push_back(method.name);
  Comparison comparison(names, options.far_m);
  ClipScores scores{
      .key_every = options.key_every, .truth = truth.kind(), .far_m = options.far_m, .notes = truth.notes()};
  int done = 0;
  for (const Batch& batch : PlanBatches(sequence, frames, one_by_one)) {
    if (options.stop.stop_requested()) return absl::CancelledError("stopped on request");
    if (options.on_frame) options.on_frame(done, static_cast<int>(frames.size()));
    std::vector<std::vector<DepthResult>> results;
    for (const ScoredMethod& method : methods) {
      ASSIGN_OR_RETURN(results.emplace_back(), RunMethod(method, keys, batch, options));
    }
    for (size_t f = 0; f < batch.frames.size(); ++f) {
      const int color = batch.frames[f];
      if (options.on_item) options.on_item();
      ASSIGN_OR_RETURN(const FrameTruth frame, truth.Read(color, options.stop));
      std::vector<MethodFrame> estimates;
      for (size_t m = 0; m < methods.size(); ++m) {
        const DepthResult& result = results[m][f];
        if (result.depth_m.empty())
          return absl::InternalError(absl::StrCat(methods[m].name, " did not answer colour frame ", color));
        estimates.push_back({.depth_m = result.depth_m.view()});
        if (methods[m].predicts_sigma) estimates.back().sigma_m = result.sigma_m.view();
      }
      const std::string stem = sequence.color[color].Stem();
      ASSIGN_OR_RETURN(const Image<Rgb8> picture, keys.Color(color));
      TruthFrame view = frame.View();
      view.color = picture;
      RETURN_IF_ERROR(WithContext(comparison.AddFrame(view, estimates), stem));
      if (options.on_scored) options.on_scored(view, estimates);
      scores.frame_stems.push_back(stem);
      ++done;
    }
  }
  scores.score = comparison.Score();
  if (truth.IsLeftOutDepth()) {
    std::vector<int> all(reference.sequence().depth.size());
    std::iota(all.begin(), all.end(), 0);
    ASSIGN_OR_RETURN(scores.sensor_floor,
                     MeasureSensorFloor(reference, options.floor_runs.value_or(std::vector<std::vector<int>>{all}),
                                        options.far_m, options.stop));
  }
  return scores;
}

absl::StatusOr<IntervalSummary> StoredResult::Run(const FrameSource& /*source*/, const ClipConstants& /*constants*/,
                                                  const Interval& interval, const RunContext& context,
                                                  const FrameSink& sink) const {
  StageRunner stages(context);
  stages.Begin("read");
  int frames = 0;
  for (int color = interval.first_frame; color < interval.first_frame + interval.frame_count; ++color) {
    RETURN_IF_ERROR(stages.CheckStop());
    const int index = frame_of_[color];
    if (index < 0) continue;
    DepthResult frame{.color_index = color};
    ASSIGN_OR_RETURN(frame.depth_m, result_.Depth(index));
    ASSIGN_OR_RETURN(frame.sigma_m, result_.Sigma(index));
    ASSIGN_OR_RETURN(frame.provenance, result_.ProvenanceAt(index));
    RETURN_IF_ERROR(sink(std::move(frame)));
    ++frames;
  }
  return stages.Complete(frames);
}

}  // namespace depthtween
