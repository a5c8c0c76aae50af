// What all baselines share: the frame under work, held intervals and the predicted noise.
#ifndef DEPTHTWEEN_CORE_BASELINES_FRAME_STEPS_H_
#define DEPTHTWEEN_CORE_BASELINES_FRAME_STEPS_H_

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "core/base/status.h"
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

// The colour frame nearest in time; the earlier one of two as near. `sequence` must be valid.
int NearestColorFrame(const Sequence& sequence, int64_t time_ns);

// An empty answer for one frame.
DepthResult BlankResult(const FrameSource& source, int color_index);

// The standard deviation of one measurement at each known depth.
void PredictMeasurementNoise(const ClipConstants& constants, DepthResult& result);

// All frames of a held interval: its one key, unmoved.
absl::Status HoldInterval(const FrameSource& source, const ClipConstants& constants, const Interval& interval,
                          const RunContext& context, const FrameSink& sink);

// Cancelled once `context.stop` has fired.
absl::Status CheckStop(const RunContext& context);

// Wall seconds of consecutive stages; tells context.on_stage when one begins.
class StageClock {
 public:
  explicit StageClock(const RunContext& context) : context_(context) {}
  void Begin(std::string_view stage);
  // Ends the last stage and fills the summary of a run that came to its end.
  IntervalSummary Finish(int frames);

 private:
  void End();

  const RunContext& context_;
  std::string stage_;
  std::chrono::steady_clock::time_point began_;
  std::map<std::string, double> seconds_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASELINES_FRAME_STEPS_H_
