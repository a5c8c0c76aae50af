// How noisy depth is, estimated from depth maps themselves.
//
// Threads: a value; guard concurrent writes.
#ifndef DEPTHTWEEN_CORE_FILL_NOISE_SAMPLES_H_
#define DEPTHTWEEN_CORE_FILL_NOISE_SAMPLES_H_

#include <array>
#include <vector>

#include "core/base/image.h"
#include "core/fill/depth_noise.h"
#include "core/sequence/rgbd_view.h"

namespace depthtween {

class NoiseSamples {
 public:
  // The noise of one pixel from the second difference of its row, (z[-1] - 2 z[0] + z[1]) / sqrt(6): blind to planes.
  void AddOverSpace(ImageView<const float> depth_m);
  // The same from one pixel's change between two depth frames that nothing moved between: what differs from frame to
  // frame is noise, what stays is the sensor's fixed pattern, which smoothing would only falsify. All of one size.
  void AddOverTime(const RgbdView& before, const RgbdView& after);

  // The model that fits what was added; a Kinect v2's when that was too little. Never below what steps of
  // `depth_step_m` make of exact depth. Robust: edges and curvature are a tail that medians ignore.
  DepthNoise Fit(double depth_step_m);

 private:
  static constexpr int kBins = 24;
  static constexpr double kBinWidth = 0.35;  // metres

  void Add(float depth_m, float residual_m);

  std::array<std::vector<float>, kBins> residuals_;  // by depth
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FILL_NOISE_SAMPLES_H_
