// E_point: the end of a trajectory lies near its partner in the other key.
//
// Residual: (p_g - q) / sigma, three rows; d(residual)/d(p_g) = 1/sigma. Weak: sigma is some pixel footprints, so that
// surfaces may slide along themselves (the plane term holds the depth). Kernel: Geman-McClure on the squared length.
#ifndef DEPTHTWEEN_CORE_SOLVE_POINT_TERM_H_
#define DEPTHTWEEN_CORE_SOLVE_POINT_TERM_H_

#include "core/solve/triple.h"

namespace depthtween {

template <typename T>
Triple<T> PointResidual(const Triple<T>& end, const Triple<T>& partner, const T& over_sigma) {
  return over_sigma * (end - partner);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_POINT_TERM_H_
