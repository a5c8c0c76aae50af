// E_plane: the end of a trajectory lies on the other key's surface.
//
// Residual: n . (p_g - q) / sigma, with q on that surface and n its unit normal; d(residual)/d(p_g) = n / sigma.
// sigma: the noise of depth. Kernel: Geman-McClure.
#ifndef DEPTHTWEEN_CORE_SOLVE_PLANE_TERM_H_
#define DEPTHTWEEN_CORE_SOLVE_PLANE_TERM_H_

#include "core/solve/triple.h"

namespace depthtween {

template <typename T>
T PlaneResidual(const Triple<T>& end, const Triple<T>& partner, const Triple<T>& normal, const T& over_sigma) {
  return over_sigma * Dot(normal, end - partner);
}
template <typename T>
Triple<T> PlaneJacobian(const Triple<T>& normal, const T& over_sigma) {
  return over_sigma * normal;
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_PLANE_TERM_H_
