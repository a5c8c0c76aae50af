// E_reg: neighbours turn alike.
//
// Residual of an edge in one frame: sqrt(2) (w_i - w_j), rotation vectors in radians. Its square is the paper's
// |R_i - R_j|^2 up to terms of fourth order, and it is linear: over frames with an orthonormal time basis it falls
// apart into one copy for each coefficient. No kernel.
#ifndef DEPTHTWEEN_CORE_SOLVE_REG_TERM_H_
#define DEPTHTWEEN_CORE_SOLVE_REG_TERM_H_

#include "core/solve/triple.h"

namespace depthtween {

template <typename T>
constexpr T kRegJacobian = T(1.4142135623730951);  // d(residual)/d(w_i); that with respect to w_j is its negative
// What it adds to the matrix for an edge: once as (i, j), once as (j, i).
constexpr float kRegPair = 2 * kRegJacobian<float> * kRegJacobian<float>;

template <typename T>
Triple<T> RegResidual(const Triple<T>& turn_i, const Triple<T>& turn_j) {
  return kRegJacobian<Scalar<T>> * (turn_i - turn_j);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_REG_TERM_H_
