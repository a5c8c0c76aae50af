// The interface behind which the pipeline and all baselines stand, and the values that cross it.
//
// Grammar of use:  Prepare Run*   - Prepare once per clip (its result is frozen and may be stored and read back), then
// Run for any intervals, in any order, in any process: the bits depend on neither order nor batching nor threads.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_UPSAMPLER_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_UPSAMPLER_H_

#include <functional>
#include <map>
#include <memory>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/sequence/depth_result.h"
#include "core/sequence/interval.h"
#include "core/sequence/sequence.h"

namespace depthtween {

// What the range of previews leaves on both sides of the depths it shows, as a share of them.
inline constexpr double kPreviewMargin = 0.05;

// Clip-wide constants, computed once before any interval.
struct ClipConstants {
  // Standard deviation of a depth measurement: sigma(z) = a + b z^2, metres.
  double noise_a_m = 0.0015;
  double noise_b_per_m = 0.0004;
  // Range shown in previews, metres: 1st and 99th percentile of the keys, widened by kPreviewMargin.
  double preview_near_m = 0.5;
  double preview_far_m = 5.0;
  // Median of all key depths, metres.
  double median_depth_m = 0.0;
  // Facts worth telling the user, such as an implausible depth_scale.
  std::vector<std::string> warnings;
};

// Noise, range and warnings from a sample of at most 16 keys, spread over the clip; with `noise_of_first_key`, noise
// from the first one, so that nothing of what comes later decides any frame. Deterministic.
absl::StatusOr<ClipConstants> EstimateClipConstants(const FrameSource& source, bool noise_of_first_key = false);

struct RunContext {
  int threads = 1;
  std::stop_token stop = {};
  // Asks for DepthResult::motion_next and motion_back, which cost memory. Depth does not depend on it.
  bool want_motion = false;
  // Called at natural seams from the calling thread, with the name of the stage about to run. May be empty.
  std::function<void(std::string_view stage)> on_stage = nullptr;
  // Called within a stage when one of the items that it is made of is done, from any thread. May be empty.
  std::function<void()> on_item = nullptr;
};

// What a Run confesses.
struct IntervalSummary {
  std::string termination = "Run was not called";
  int frames = -1;
  std::map<std::string, double> stage_seconds;  // wall seconds by stage name
};

// How many depth frames a run looks at before its interval's first key and after its second.
struct KeyReach {
  int before = 0, after = 0;
};

// Receives finished frames in time order, on the calling thread. An error stops the run and is returned by it.
using FrameSink = std::function<absl::Status(DepthResult)>;

class Upsampler {
 public:
  virtual ~Upsampler() = default;
  virtual std::string_view name() const = 0;
  virtual KeyReach reach() const { return {}; }
  // Frames of one interval of PlanIntervals(source.sequence()). Errors: what the source returns; Cancelled when
  // context.stop fires. Threads: safe to call concurrently.
  virtual absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                              const Interval& interval, const RunContext& context,
                                              const FrameSink& sink) const = 0;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_UPSAMPLER_H_
