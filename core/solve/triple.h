// Points, rotations and projection for any kind of number: float, eight floats at once (base/lanes.h), double, and the
// dual numbers that tests differentiate with. One text of each formula serves the solver and its oracle.
//
// Units: metres for points, radians for rotation vectors, pixels for projections. Threads: plain values.
#ifndef DEPTHTWEEN_CORE_SOLVE_TRIPLE_H_
#define DEPTHTWEEN_CORE_SOLVE_TRIPLE_H_

#include "core/base/lanes.h"

namespace depthtween {

// The number that a constant beside a T has to be.
template <typename T>
struct ScalarOf {
  using type = T;
};
template <>
struct ScalarOf<Lanes> {
  using type = float;
};
template <typename T>
using Scalar = typename ScalarOf<T>::type;

template <typename T>
struct Triple {
  T x, y, z;
};
template <typename T>
Triple<T> operator+(const Triple<T>& a, const Triple<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename T>
Triple<T> operator-(const Triple<T>& a, const Triple<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename T, typename S>
Triple<T> operator*(const S& s, const Triple<T>& a) {
  return {s * a.x, s * a.y, s * a.z};
}
template <typename T>
T Dot(const Triple<T>& a, const Triple<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <typename T>
Triple<T> Cross(const Triple<T>& a, const Triple<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// sin(t)/t, (1 - cos(t))/t^2 and (t - sin(t))/t^3 from t^2, as series: no branch and no root. Exact to a float's last
// digits up to half a turn, beyond which no point turns between two depth frames.
template <typename T>
struct TurnSeries {
  T sine, cosine, rest;
};
template <typename T>
TurnSeries<T> SeriesOf(const T& t2) {
  using S = Scalar<T>;
  const auto series = [&](S first) {  // 1/first! - t^2/(first + 2)! + ...
    constexpr int kTerms = 8;
    S factorial[kTerms];
    S value = 1;
    for (int n = 2; n <= static_cast<int>(first); ++n) value *= static_cast<S>(n);
    factorial[0] = value;
    for (int k = 1; k < kTerms; ++k)
      factorial[k] = factorial[k - 1] * (first + static_cast<S>(2 * k - 1)) * (first + static_cast<S>(2 * k));
    T sum = t2 * (S(-1) / factorial[kTerms - 1]) + S(1) / factorial[kTerms - 2];
    for (int k = kTerms - 3; k >= 0; --k) sum = S(1) / factorial[k] - t2 * sum;
    return sum;
  };
  return {series(1), series(2), series(3)};
}

// exp of a rotation vector, as rows.
template <typename T>
struct Rotation {
  Triple<T> row[3];
  Triple<T> operator*(const Triple<T>& p) const { return {Dot(row[0], p), Dot(row[1], p), Dot(row[2], p)}; }
};
// 1 + a [w] + b [w]^2, [w] v = w x v.
template <typename T>
Rotation<T> AboutAxis(const Triple<T>& w, const T& a, const T& b) {
  using S = Scalar<T>;
  const T xy = b * w.x * w.y, xz = b * w.x * w.z, yz = b * w.y * w.z;
  return {{{S(1) - b * (w.y * w.y + w.z * w.z), xy - a * w.z, xz + a * w.y},
           {xy + a * w.z, S(1) - b * (w.x * w.x + w.z * w.z), yz - a * w.x},
           {xz - a * w.y, yz + a * w.x, S(1) - b * (w.x * w.x + w.y * w.y)}}};
}
template <typename T>
Rotation<T> RotationOf(const Triple<T>& w) {
  const TurnSeries<T> series = SeriesOf(Dot(w, w));
  return AboutAxis(w, series.sine, series.cosine);
}

// The derivative of exp: exp(w + d) p = exp(w) p + (J d) x (exp(w) p), J the left Jacobian of SO(3): a matrix, though
// no rotation.
template <typename T>
Rotation<T> LeftJacobianOf(const Triple<T>& w) {
  const TurnSeries<T> series = SeriesOf(Dot(w, w));
  return AboutAxis(w, series.cosine, series.rest);
}
// J^T v.
template <typename T>
Triple<T> LeftJacobianTransposed(const Triple<T>& w, const Triple<T>& v) {
  const TurnSeries<T> series = SeriesOf(Dot(w, w));
  const Triple<T> once = Cross(w, v), twice = Cross(w, once);
  return v - series.cosine * once + series.rest * twice;
}

// A pinhole without distortion: inside the solver pixels are ideal ones.
template <typename S>
struct Pinhole {
  S fx, fy, cx, cy;
};
template <typename T>
struct PixelOf {
  T u, v;
};
// p.z > 0.
template <typename T>
PixelOf<T> Project(const Pinhole<Scalar<T>>& camera, const Triple<T>& p) {
  const T over_z = Scalar<T>(1) / p.z;
  return {camera.fx * (p.x * over_z) + camera.cx, camera.fy * (p.y * over_z) + camera.cy};
}
// The two rows of d(pixel)/d(point).
template <typename T>
struct ProjectionRows {
  Triple<T> u, v;
};
template <typename T>
ProjectionRows<T> ProjectionJacobian(const Pinhole<Scalar<T>>& camera, const Triple<T>& p) {
  const T over_z = Scalar<T>(1) / p.z, zero = p.z * Scalar<T>(0);
  const T ru = camera.fx * over_z, rv = camera.fy * over_z;
  return {{ru, zero, Scalar<T>(-1) * ru * (p.x * over_z)}, {zero, rv, Scalar<T>(-1) * rv * (p.y * over_z)}};
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_TRIPLE_H_
