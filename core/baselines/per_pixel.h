// Baselines that look at one pixel of both keys and at the time, and at nothing else.
#ifndef DEPTHTWEEN_CORE_BASELINES_PER_PIXEL_H_
#define DEPTHTWEEN_CORE_BASELINES_PER_PIXEL_H_

#include <string_view>

#include "core/baselines/frame_steps.h"

namespace depthtween {

// From the depth of both keys at a pixel (0 = unknown) and tau in [0,1].
using PixelRule = PixelAnswer (*)(float before_m, float after_m, double tau);

PixelAnswer HoldPixel(float before_m, float after_m, double tau);
PixelAnswer NearestPixel(float before_m, float after_m, double tau);
PixelAnswer LinearPixel(float before_m, float after_m, double tau);

// `name` must outlive the baseline.
class PerPixelBaseline : public Upsampler {
 public:
  PerPixelBaseline(std::string_view name, PixelRule rule) : name_(name), rule_(rule) {}
  std::string_view name() const override { return name_; }
  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override;

 private:
  const std::string_view name_;
  const PixelRule rule_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASELINES_PER_PIXEL_H_
