// E_rigid: around each point the surface moves as one rigid piece.
//
// Residual of the directed edge (i, j) in one frame: p_i - p_j - R_i e, e = p_{k,i} - p_{k,j}; its weight is divided by
// |e|^2, so that it measures strain, whatever the pitch of the grid and the distance. No kernel: the weights of edges
// are cut instead.
#ifndef DEPTHTWEEN_CORE_SOLVE_RIGID_TERM_H_
#define DEPTHTWEEN_CORE_SOLVE_RIGID_TERM_H_

#include "core/solve/triple.h"

namespace depthtween {

// `moved` = (p_i - p_{k,i}) - (p_j - p_{k,j}), `edge` = e, `turned` = R_i e: near zero motion nothing cancels.
template <typename T>
Triple<T> RigidResidual(const Triple<T>& moved, const Triple<T>& edge, const Triple<T>& turned) {
  return moved + (edge - turned);
}
// J^T v for the rotation: d(residual)/d(w_i) = [R_i e] J with J the left Jacobian, which is applied afterwards, once
// for all edges of a point (LeftJacobianTransposed). With respect to p_i it is 1, to p_j it is -1.
template <typename T>
Triple<T> RigidTorque(const Triple<T>& turned, const Triple<T>& v) {
  return Cross(v, turned);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_RIGID_TERM_H_
