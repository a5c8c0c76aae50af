// Where a surface tears: neighbours that were joined in the key and whose distance changes on the way.
//
// Source: Yuan et al. 2018, section 3.4. We differ: the change is measured against the length of the edge and the noise
// of depth (half the length alone cuts a tenth of still, smooth edges on real sensors), at the end of the interval too.
#ifndef DEPTHTWEEN_CORE_SOLVE_TOPOLOGY_H_
#define DEPTHTWEEN_CORE_SOLVE_TOPOLOGY_H_

#include <algorithm>
#include <cmath>

namespace depthtween {

constexpr float kTornShare = 0.5F;  // of the edge's length
constexpr float kTornSigmas = 3.0F;

// `length_m` in the key, `moved_m` on the way, `sigma_m` of one depth.
inline bool Torn(float length_m, float moved_m, float sigma_m) {
  return std::abs(moved_m - length_m) > std::max(kTornShare * length_m, kTornSigmas * std::sqrt(2.0F) * sigma_m);
}

// The paper's published weight: how well the edge keeps its length.
inline float PrintedTopologyWeight(float length_m, float moved_m) {
  constexpr float kSigma = 0.015F;
  return std::exp(-(moved_m - length_m) * (moved_m - length_m) / (kSigma * kSigma));
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_TOPOLOGY_H_
