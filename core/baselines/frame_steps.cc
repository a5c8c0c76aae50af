#include "core/baselines/frame_steps.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

absl::StatusOr<Image<float>> ReadKey(const FrameSource& source, int key) {
  ASSIGN_OR_RETURN(Image<float> depth_m, source.Depth(key));
  const Sequence& sequence = source.sequence();
  const Camera& camera = sequence.camera;
  if (depth_m.width() != camera.width || depth_m.height() != camera.height)
    return absl::InvalidArgumentError(absl::StrFormat("%s is %d x %d, must be %d x %d as the camera says",
                                                      sequence.depth[key].path, depth_m.width(), depth_m.height(),
                                                      camera.width, camera.height));
  return depth_m;
}

}  // namespace

absl::StatusOr<KeyPair> ReadKeys(const FrameSource& source, const Interval& interval) {
  KeyPair keys;
  ASSIGN_OR_RETURN(keys.before_m, ReadKey(source, interval.key_before));
  ASSIGN_OR_RETURN(keys.after_m, ReadKey(source, interval.key_after));
  keys.before_ns = source.sequence().depth[interval.key_before].time_ns;
  keys.after_ns = source.sequence().depth[interval.key_after].time_ns;
  return keys;
}

absl::StatusOr<Image<Rgb8>> ReadColor(const FrameSource& source, int color_index) {
  ASSIGN_OR_RETURN(Image<Rgb8> color, source.Color(color_index));
  const Sequence& sequence = source.sequence();
  if (color.width() != sequence.camera.width || color.height() != sequence.camera.height)
    return absl::InvalidArgumentError(absl::StrFormat("%s is %d x %d, must be %d x %d as the camera says",
                                                      sequence.color[color_index].path, color.width(), color.height(),
                                                      sequence.camera.width, sequence.camera.height));
  return color;
}

DepthResult BlankResult(const FrameSource& source, int color_index) {
  const Camera& camera = source.sequence().camera;
  return {.color_index = color_index,
          .depth_m = Image<float>(camera.width, camera.height),
          .sigma_m = Image<float>(camera.width, camera.height),
          .provenance = Image<Provenance>(camera.width, camera.height)};
}

void PredictMeasurementNoise(const ClipConstants& constants, DepthResult& result) {
  for (int y = 0; y < result.depth_m.height(); ++y) {
    for (int x = 0; x < result.depth_m.width(); ++x) {
      const double z = result.depth_m(x, y);
      if (z > 0.0) result.sigma_m(x, y) = static_cast<float>(constants.noise_a_m + constants.noise_b_per_m * z * z);
    }
  }
}

absl::StatusOr<IntervalSummary> HoldInterval(const FrameSource& source, const ClipConstants& constants,
                                             const Interval& interval, const RunContext& context,
                                             const FrameSink& sink) {
  StageRunner stages(context);
  stages.Begin("hold");
  ASSIGN_OR_RETURN(const Image<float> key_m, ReadKey(source, std::max(interval.key_before, interval.key_after)));
  for (int i = 0; i < interval.frame_count; ++i) {
    RETURN_IF_ERROR(stages.CheckStop());
    DepthResult result = BlankResult(source, interval.first_frame + i);
    result.depth_m = key_m.Clone();
    for (int y = 0; y < key_m.height(); ++y)
      for (int x = 0; x < key_m.width(); ++x)
        if (key_m(x, y) > 0.0F) result.provenance(x, y) = Provenance::kHeld;
    PredictMeasurementNoise(constants, result);
    RETURN_IF_ERROR(sink(std::move(result)));
  }
  return stages.Complete(interval.frame_count);
}

}  // namespace depthtween
