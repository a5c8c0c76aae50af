// The plain practitioner's method, and the baseline to beat: sample both keys along dense flow, backward from each
// frame.
//
// Its edges follow the flow of the observed colour frame, which is why it is strong: a forward splat of composed flow
// is not. Flow: OpenCV's DIS at preset medium, straight between the frame and each key's colour frame, both ways. Depth
// of each key: that of the nearest pixel to where the flow lands. Weight of each key: exp(-e^2), e the forward-backward
// error in pixels, times closeness in time. The two are blended where they agree within 5 %, else the heavier wins;
// pixels that neither key answers hold the nearer key. A key whose stamp lies between colour frames is taken to be seen
// by the nearest of them.
#ifndef DEPTHTWEEN_CORE_BASELINES_FLOW_WARP_H_
#define DEPTHTWEEN_CORE_BASELINES_FLOW_WARP_H_

#include <string_view>

#include "core/upsample/upsampler.h"

namespace depthtween {

class FlowWarpBaseline : public Upsampler {
 public:
  std::string_view name() const override { return "flow-warp"; }
  // Also: Internal if OpenCV fails.
  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASELINES_FLOW_WARP_H_
