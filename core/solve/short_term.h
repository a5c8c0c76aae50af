// E_short: a trajectory does not jerk.
//
// Residual: the second divided difference of three positions over their times, in pixel footprints of the key per
// interval^2, over its deviation. In the paper, |p_s - p_{s-1}|^2 shrinks motion in depth; a 1e-3 share of it is kept,
// for points that nothing else holds. Linear; no kernel.
#ifndef DEPTHTWEEN_CORE_SOLVE_SHORT_TERM_H_
#define DEPTHTWEEN_CORE_SOLVE_SHORT_TERM_H_

#include "core/solve/triple.h"

namespace depthtween {

constexpr float kPrintedShortShare = 1e-3F;

// Factors of the positions before, now and after: the residual is their sum, times 1/(footprint sigma).
template <typename S>
struct ShortJacobian {
  S before, now, after;
};
// Times ascend.
template <typename S>
ShortJacobian<S> AccelerationFactors(S before, S now, S after) {
  const S first = now - before, second = after - now, half = (after - before) / S(2);
  return {S(1) / (first * half), S(-1) / (first * half) - S(1) / (second * half), S(1) / (second * half)};
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_SHORT_TERM_H_
