// Visibility weight of a point's flow: the point may be occluded in the next frame, or its flow bleed from a neighbour.
//
// Source: Yuan et al. 2018, section 3.3, after Sand and Teller, Particle Video, 2006. We differ: only negative
// divergence counts (positive divergence means disocclusion), forward and backward flow must be consistent, and near a
// depth jump no flow is trusted in full, since motion bleeding over from the other side passes every other test.
#ifndef DEPTHTWEEN_CORE_SOLVE_OCCLUSION_H_
#define DEPTHTWEEN_CORE_SOLVE_OCCLUSION_H_

#include <algorithm>
#include <cmath>

#include "core/base/image.h"

namespace depthtween {

// Deviations of each test: of divergence (1 = two pixels became one), of brightness ([0, 1]; the paper's 20 of 255), of
// the way back (pixels, and share of the motion).
constexpr float kDivergenceSigma = 0.5F, kHiddenBrightnessSigma = 20.0F / 255.0F;
constexpr float kReturnSigmaPx = 0.5F, kReturnSigmaShare = 0.1F;
// Flow of 8-pixel patches at half resolution knows nothing of a jump from here on.
constexpr float kFullTrustPx = 4.0F;

// Weight in (0, 1] of a step `flow` whose way back is `back`, where the flow field has this divergence and brightness
// changes by `brightness` along it.
inline float VisibleWeight(Flow2 flow, Flow2 back, float divergence, float brightness) {
  const float d = std::min(0.0F, divergence) / kDivergenceSigma, b = brightness / kHiddenBrightnessSigma;
  const float u = flow.u + back.u, v = flow.v + back.v;
  const float length2 = flow.u * flow.u + flow.v * flow.v;
  const float sigma2 = kReturnSigmaPx * kReturnSigmaPx + kReturnSigmaShare * kReturnSigmaShare * length2;
  return std::exp(-(d * d + b * b + (u * u + v * v) / sigma2));
}

// The paper's published O: disocclusion counts like occlusion, and forward-backward consistency is not checked.
inline float PrintedVisibleWeight(float divergence, float brightness) {
  const float b = brightness / kHiddenBrightnessSigma;
  return std::exp(-(divergence * divergence + b * b));  // sigma_1 = 1
}

// Weight of data at this distance from a depth jump, pixels.
inline float JumpWeight(float distance_px) { return std::min(1.0F, distance_px / kFullTrustPx); }

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_OCCLUSION_H_
