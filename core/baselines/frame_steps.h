// What all baselines share: the frame under work, held intervals, the key that is nearer in time and the predicted
// noise.
#ifndef DEPTHTWEEN_CORE_BASELINES_FRAME_STEPS_H_
#define DEPTHTWEEN_CORE_BASELINES_FRAME_STEPS_H_

#include <cstddef>
#include <cstdint>

#include "core/base/status.h"
#include "core/upsample/stage_runner.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

// The two keys of an interval that is not held.
struct KeyPair {
  Image<float> before_m, after_m;
  int64_t before_ns = 0, after_ns = 0;

  // Of a frame: 0 at the key before, 1 at the key after.
  double Tau(int64_t time_ns) const {
    return static_cast<double>(time_ns - before_ns) / static_cast<double>(after_ns - before_ns);
  }
};

// InvalidArgument if a decoded depth map is not of the camera's size.
absl::StatusOr<KeyPair> ReadKeys(const FrameSource& source, const Interval& interval);

// InvalidArgument if the decoded image is not of the camera's size.
absl::StatusOr<Image<Rgb8>> ReadColor(const FrameSource& source, int color_index);

// An empty answer for one frame.
DepthResult BlankResult(const FrameSource& source, int color_index);

// The standard deviation of one measurement at each known depth.
void PredictMeasurementNoise(const ClipConstants& constants, DepthResult& result);

// What a method says of one pixel.
struct PixelAnswer {
  float depth_m = 0.0F;  // 0: nothing
  Provenance provenance = Provenance::kNone;
};

// The key that is nearer in time to a frame at `tau`: at its own time its measurements go first, elsewhere they are the
// last resort. Borrows both maps.
class NearerKey {
 public:
  NearerKey(const Image<float>& before_m, const Image<float>& after_m, double tau)
      : depth_m_(tau <= 0.5 ? before_m : after_m), at_its_time_(tau == 0.0 || tau == 1.0) {}

  // What stands at a pixel, counted row by row, where the method itself says `own`.
  PixelAnswer Complete(const PixelAnswer& own, size_t pixel) const {
    const float key_m = depth_m_.data()[pixel];
    if (at_its_time_ && key_m > 0.0F) return {key_m, Provenance::kMeasured};
    if (own.depth_m > 0.0F) return own;
    return key_m > 0.0F ? PixelAnswer{key_m, Provenance::kInferred} : PixelAnswer{};
  }

 private:
  const Image<float>& depth_m_;
  const bool at_its_time_;
};

// The whole run of a held interval: all its frames are its one key, unmoved.
absl::StatusOr<IntervalSummary> HoldInterval(const FrameSource& source, const ClipConstants& constants,
                                             const Interval& interval, const RunContext& context,
                                             const FrameSink& sink);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASELINES_FRAME_STEPS_H_
