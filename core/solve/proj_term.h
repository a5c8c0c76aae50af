// E_proj: a trajectory is seen to move as the images move. Pixels over the flow's deviation; kernel: Geman-McClure on
// the squared length.
//
// Step:  (pi(p_s) - pi(p_{s-1}) - v_{s-1}) / sigma, s = 1..g, the flow read where the point is. The paper projects
//        p_s - p_{s-1}, which has no meaning, and leaves out the first step, the most reliable one.
// Track: (pi(p_s) - u_s) / sigma_s, u_s the flow composed from the key on: steps random-walk, tracks do not.
#ifndef DEPTHTWEEN_CORE_SOLVE_PROJ_TERM_H_
#define DEPTHTWEEN_CORE_SOLVE_PROJ_TERM_H_

#include "core/solve/triple.h"

namespace depthtween {

template <typename T>
PixelOf<T> StepResidual(const PixelOf<T>& before, const PixelOf<T>& now, const PixelOf<T>& flow, Scalar<T> over_sigma) {
  return {(now.u - before.u - flow.u) * over_sigma, (now.v - before.v - flow.v) * over_sigma};
}
template <typename T>
PixelOf<T> TrackResidual(const PixelOf<T>& now, const PixelOf<T>& track, Scalar<T> over_sigma) {
  return {(now.u - track.u) * over_sigma, (now.v - track.v) * over_sigma};
}
// d(residual)/d(p_s) of both; that with respect to p_{s-1} is its negative, at p_{s-1}.
template <typename T>
ProjectionRows<T> ProjJacobian(const ProjectionRows<T>& rows, Scalar<T> over_sigma) {
  return {over_sigma * rows.u, over_sigma * rows.v};
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_PROJ_TERM_H_
