// E_opti: a point keeps its brightness along its trajectory.
//
// Residual: (C_s(pi(p_s)) - C_0(x)) / sigma_c, C_s linearised where the trajectory was last predicted to be seen. The
// paper compares neighbouring frames; summed along a trajectory those differences telescope to this one, which does not
// drift and leaves the frames independent. Colours in [0, 1], pixels; kernel: Charbonnier.
#ifndef DEPTHTWEEN_CORE_SOLVE_OPTI_TERM_H_
#define DEPTHTWEEN_CORE_SOLVE_OPTI_TERM_H_

#include "core/solve/triple.h"

namespace depthtween {

// The image around `at`: its brightness less the key's, and its gradient per pixel.
template <typename T>
struct BrightnessAt {
  PixelOf<T> at;
  T difference, slope_u, slope_v;
};

template <typename T>
T OptiResidual(const BrightnessAt<T>& image, const PixelOf<T>& seen, Scalar<T> over_sigma) {
  return (image.difference + image.slope_u * (seen.u - image.at.u) + image.slope_v * (seen.v - image.at.v)) *
         over_sigma;
}
// d(residual)/d(p), from the rows of d(seen)/d(p).
template <typename T>
Triple<T> OptiJacobian(const BrightnessAt<T>& image, const ProjectionRows<T>& rows, Scalar<T> over_sigma) {
  return over_sigma * (image.slope_u * rows.u + image.slope_v * rows.v);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_OPTI_TERM_H_
