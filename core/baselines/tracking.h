// Surfaces tracked from depth alone: the joint optimisation without colour and without flow.
//
// Points of each key look for partners near where they are predicted to be, from standing still on, and are held
// together by rigidity; what lies between is on a straight line in time. Each frame shows the surface of the nearer key
// that reaches it, else of the other, else the nearer key where it was. Stands for what the literature calls non-rigid
// tracking; source: Yuan et al. 2018, section 5 ("tracking"), as E_point, E_plane, E_rigid and E_reg of core/solve.
#ifndef DEPTHTWEEN_CORE_BASELINES_TRACKING_H_
#define DEPTHTWEEN_CORE_BASELINES_TRACKING_H_

#include <string_view>

#include "core/upsample/upsampler.h"

namespace depthtween {

class TrackingBaseline : public Upsampler {
 public:
  std::string_view name() const override { return "tracking"; }
  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASELINES_TRACKING_H_
