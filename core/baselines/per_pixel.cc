#include "core/baselines/per_pixel.h"

#include <utility>

namespace depthtween {
namespace {

PixelAnswer OneKey(float depth_m, bool at_key_time) {
  if (depth_m == 0.0F) return {};
  return {depth_m, at_key_time ? Provenance::kMeasured : Provenance::kOne};
}

}  // namespace

// At tau = 1 the frame coincides with the key after, which is then the latest key.
PixelAnswer HoldPixel(float before_m, float after_m, double tau) {
  return tau < 1.0 ? OneKey(before_m, tau == 0.0) : OneKey(after_m, true);
}

PixelAnswer NearestPixel(float before_m, float after_m, double tau) {
  return tau <= 0.5 ? OneKey(before_m, tau == 0.0) : OneKey(after_m, tau == 1.0);
}

PixelAnswer LinearPixel(float before_m, float after_m, double tau) {
  if (after_m == 0.0F) return OneKey(before_m, tau == 0.0);
  if (before_m == 0.0F) return OneKey(after_m, tau == 1.0);
  if (tau == 0.0) return OneKey(before_m, true);
  if (tau == 1.0) return OneKey(after_m, true);
  return {static_cast<float>((1.0 - tau) * before_m + tau * after_m), Provenance::kBoth};
}

absl::StatusOr<IntervalSummary> PerPixelBaseline::Run(const FrameSource& source, const ClipConstants& constants,
                                                      const Interval& interval, const RunContext& context,
                                                      const FrameSink& sink) const {
  if (interval.Held()) return HoldInterval(source, constants, interval, context, sink);
  StageRunner stages(context);
  stages.Begin("read");
  ASSIGN_OR_RETURN(const KeyPair keys, ReadKeys(source, interval));
  stages.Begin("interpolate");
  for (int i = 0; i < interval.frame_count; ++i) {
    RETURN_IF_ERROR(stages.CheckStop());
    DepthResult result = BlankResult(source, interval.first_frame + i);
    const double tau = keys.Tau(source.sequence().color[result.color_index].time_ns);
    for (int y = 0; y < result.depth_m.height(); ++y) {
      for (int x = 0; x < result.depth_m.width(); ++x) {
        const PixelAnswer answer = rule_(keys.before_m(x, y), keys.after_m(x, y), tau);
        result.depth_m(x, y) = answer.depth_m;
        result.provenance(x, y) = answer.provenance;
      }
    }
    PredictMeasurementNoise(constants, result);
    RETURN_IF_ERROR(sink(std::move(result)));
  }
  return stages.Complete(interval.frame_count);
}

}  // namespace depthtween
