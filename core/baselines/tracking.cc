#include "core/baselines/tracking.h"

#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/baselines/frame_steps.h"
#include "core/solve/solve.h"
#include "core/upsample/key_surface.h"

namespace depthtween {
namespace {

// Depth only; searches for partners anew as often as the paper does.
SolveOptions DepthAlone() {
  SolveOptions options{.occlusion = false, .outer_iterations = 5};
  options.weights.opti = options.weights.proj = 0;
  return options;
}

}  // namespace

absl::StatusOr<IntervalSummary> TrackingBaseline::Run(const FrameSource& source, const ClipConstants& constants,
                                                      const Interval& interval, const RunContext& context,
                                                      const FrameSink& sink) const {
  if (interval.Held()) return HoldInterval(source, constants, interval, context, sink);
  StageRunner stages(context);
  stages.Begin("read");
  const Sequence& sequence = source.sequence();
  ASSIGN_OR_RETURN(const KeyPair keys, ReadKeys(source, interval));
  std::vector<double> taus;
  for (int i = 0; i < interval.frame_count; ++i)
    taus.push_back(keys.Tau(sequence.color[interval.first_frame + i].time_ns));

  stages.Begin("solve");
  const Image<Rgb8> no_color(sequence.camera.width, sequence.camera.height);
  const std::array<SolveKey, 2> ends = {SolveKey{keys.before_m, no_color, {}}, SolveKey{keys.after_m, no_color, {}}};
  std::array<std::vector<int>, 2> index;  // [side][frame of the interval]: of the solve's, -1 at its own key
  std::array<absl::StatusOr<KeySurface>, 2> surfaces = {absl::UnknownError("not run"), absl::UnknownError("not run")};
  ParallelFor(2, context.threads, [&](int side) {
    SolveProblem path{.camera = sequence.camera,
                      .key = ends[side],
                      .other = ends[1 - side],
                      .noise = {static_cast<float>(constants.noise_a_m), static_cast<float>(constants.noise_b_per_m)}};
    index[side].assign(taus.size(), -1);
    const int count = static_cast<int>(taus.size());
    for (int k = 0; k < count; ++k) {
      const int i = side == 0 ? k : count - 1 - k;
      const double since = side == 0 ? taus[i] : 1 - taus[i];
      if (since <= 0 || since >= 1) continue;
      index[side][i] = static_cast<int>(path.frames.size());
      path.frames.push_back({.time = static_cast<float>(since)});
    }
    path.frames.push_back({.time = 1.0F});
    surfaces[side] = KeySurface::Solved(path, DepthAlone());
  });
  for (const auto& surface : surfaces) RETURN_IF_ERROR(surface.status());

  for (int i = 0; i < interval.frame_count; ++i) {
    RETURN_IF_ERROR(stages.CheckStop());
    stages.Begin("draw");
    DepthResult result = BlankResult(source, interval.first_frame + i);
    const int nearer = taus[i] <= 0.5 ? 0 : 1;
    const NearerKey nearer_key(keys.before_m, keys.after_m, taus[i]);
    std::array<DrawnSurface, 2> seen;
    for (int side = 0; side < 2; ++side)
      if (index[side][i] >= 0) seen[side] = surfaces[side]->SeenIn(index[side][i]);
    for (size_t p = 0; p < result.depth_m.pixel_count(); ++p) {
      const auto drawn = [&](int side) { return seen[side].depth_m.empty() ? 0.0F : seen[side].depth_m.data()[p]; };
      const float z = drawn(nearer) > 0 ? drawn(nearer) : drawn(1 - nearer);
      const PixelAnswer answer = nearer_key.Complete({z, Provenance::kOne}, p);
      result.depth_m.data()[p] = answer.depth_m;
      result.provenance.data()[p] = answer.provenance;
    }
    PredictMeasurementNoise(constants, result);
    RETURN_IF_ERROR(sink(std::move(result)));
  }
  return stages.Complete(interval.frame_count);
}

}  // namespace depthtween
