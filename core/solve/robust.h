// Robust kernels: the cost rho(s) of a whitened squared residual s, and the weight rho'(s) that Gauss-Newton gives it.
#ifndef DEPTHTWEEN_CORE_SOLVE_ROBUST_H_
#define DEPTHTWEEN_CORE_SOLVE_ROBUST_H_

#include <cmath>

#include "core/solve/triple.h"

namespace depthtween {

template <typename T>
struct Robust {
  T cost, weight;
};

// s / (1 + s/c^2): squared for small residuals, constant (c^2) for large ones, so that what belongs to another surface
// pulls at nothing. Source: Geman and McClure, 1987.
template <typename T>
Robust<T> GemanMcClure(const T& s, Scalar<T> c2) {
  const T share = Scalar<T>(1) / (Scalar<T>(1) + s * (Scalar<T>(1) / c2));
  return {s * share, share * share};
}

inline float RootOf(float v) { return std::sqrt(v); }
inline double RootOf(double v) { return std::sqrt(v); }
inline Lanes RootOf(Lanes v) {
  Lanes root;
  for (int i = 0; i < kLanes; ++i) root[i] = std::sqrt(v[i]);
  return root;
}

// 2 (sqrt(1 + s) - 1): the paper's rho(r) = sqrt(r^2 + eps^2) with eps the deviation that s was whitened by, scaled to
// be s for small s and shifted to be 0 at 0.
template <typename T>
Robust<T> Charbonnier(const T& s) {
  const T root = RootOf(s + Scalar<T>(1));
  return {Scalar<T>(2) * (root - Scalar<T>(1)), Scalar<T>(1) / root};
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_ROBUST_H_
