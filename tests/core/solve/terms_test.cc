// Jacobians against central differences in double precision: both come from the same residual, so they must agree to
// the differences' own error.
#include <cmath>
#include <functional>

#include "core/solve/opti_term.h"
#include "core/solve/plane_term.h"
#include "core/solve/point_term.h"
#include "core/solve/proj_term.h"
#include "core/solve/reg_term.h"
#include "core/solve/rigid_term.h"
#include "core/solve/robust.h"
#include "core/solve/short_term.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using Point = Triple<double>;
constexpr double kStep = 1e-6, kTolerance = 1e-7;
constexpr Pinhole<double> kCamera{365, 360, 255.5, 211.5};
constexpr Point kPoint{0.3, -0.2, 1.7};

Point Slope(const std::function<double(Point)>& f, const Point& at) {
  const auto along = [&](Point d) { return (f(at + kStep * d) - f(at - kStep * d)) / (2 * kStep); };
  return {along({1, 0, 0}), along({0, 1, 0}), along({0, 0, 1})};
}
void ExpectNear(const Point& expected, const Point& actual, double scale = 1) {
  EXPECT_NEAR(expected.x, actual.x, kTolerance * scale);
  EXPECT_NEAR(expected.y, actual.y, kTolerance * scale);
  EXPECT_NEAR(expected.z, actual.z, kTolerance * scale);
}

TEST(ProjTerm, StepAndTrackJacobians) {
  const ProjectionRows<double> j = ProjJacobian(ProjectionJacobian<double>(kCamera, kPoint), 4.0);
  const PixelOf<double> before{250, 200}, flow{3, -2}, track{310, 150};
  const auto step = [&](Point p) { return StepResidual(before, Project<double>(kCamera, p), flow, 4.0); };
  const auto to_track = [&](Point p) { return TrackResidual(Project<double>(kCamera, p), track, 4.0); };
  ExpectNear(Slope([&](Point p) { return step(p).u; }, kPoint), j.u, 1e3);
  ExpectNear(Slope([&](Point p) { return step(p).v; }, kPoint), j.v, 1e3);
  ExpectNear(Slope([&](Point p) { return to_track(p).u; }, kPoint), j.u, 1e3);
  ExpectNear(Slope([&](Point p) { return to_track(p).v; }, kPoint), j.v, 1e3);
  // With respect to the point before, the negative.
  const PixelOf<double> now{255, 204};
  const ProjectionRows<double> back = ProjJacobian(ProjectionJacobian<double>(kCamera, kPoint), -4.0);
  ExpectNear(Slope([&](Point p) { return StepResidual(Project<double>(kCamera, p), now, flow, 4.0).u; }, kPoint),
             back.u, 1e3);
}

TEST(OptiTerm, Jacobian) {
  const BrightnessAt<double> image{{320, 170}, 0.1, 0.02, -0.03};
  const Point j = OptiJacobian(image, ProjectionJacobian<double>(kCamera, kPoint), 50.0);
  ExpectNear(Slope([&](Point p) { return OptiResidual(image, Project<double>(kCamera, p), 50.0); }, kPoint), j, 1e3);
}

TEST(PointAndPlaneTerm, Jacobians) {
  const Point q{0.28, -0.21, 1.69}, n{0.6, 0, -0.8};
  ExpectNear(Slope([&](Point p) { return PlaneResidual(p, q, n, 500.0); }, kPoint), PlaneJacobian(n, 500.0), 1e3);
  ExpectNear(Slope([&](Point p) { return PointResidual(p, q, 80.0).y; }, kPoint), {0, 80, 0}, 1e3);
}

// The rotation's derivative is taken far from rest, where exp is not linear.
TEST(RigidTerm, JacobianOfPointsAndRotation) {
  const Point turn{0.9, -0.5, 0.7}, edge{0.01, 0.02, -0.005}, moved{0.003, -0.001, 0.002}, v{0.4, -1.1, 0.3};
  const auto along_v = [&](Point w, Point m) { return Dot(v, RigidResidual(m, edge, RotationOf(w) * edge)); };
  ExpectNear(Slope([&](Point w) { return along_v(w, moved); }, turn),
             LeftJacobianTransposed(turn, RigidTorque(RotationOf(turn) * edge, v)));
  ExpectNear(Slope([&](Point m) { return along_v(turn, m); }, moved), v);
}

// A rigid motion is no strain.
TEST(RigidTerm, VanishesForRigidMotion) {
  const Point turn{0.2, 0.1, -0.3}, edge{0.01, 0.02, -0.005};
  const Point turned = RotationOf(turn) * edge;
  const Point r = RigidResidual(turned - edge, edge, turned);
  ExpectNear(r, {0, 0, 0});
}

TEST(RegTerm, EqualsThePrintedTermForSmallDifferences) {
  const Point a{0.21, 0.1, -0.3}, b{0.2, 0.11, -0.3};
  ExpectNear(Slope([&](Point w) { return RegResidual(w, b).x; }, a), {kRegJacobian<double>, 0, 0});
  const Rotation<double> ra = RotationOf(a), rb = RotationOf(b);
  double printed = 0;
  for (int row = 0; row < 3; ++row) printed += Dot(ra.row[row] - rb.row[row], ra.row[row] - rb.row[row]);
  const Point r = RegResidual(a, b);
  EXPECT_NEAR(printed, Dot(r, r), 0.05 * printed);
}

// Exact for a parabola, whatever the gaps between frames.
TEST(ShortTerm, SecondDifferenceOfAParabola) {
  const double t[3] = {0.1, 0.25, 0.6};
  const auto at = [](double time) { return 3 + 2 * time - 5 * time * time; };
  const ShortJacobian<double> f = AccelerationFactors(t[0], t[1], t[2]);
  EXPECT_NEAR(f.before * at(t[0]) + f.now * at(t[1]) + f.after * at(t[2]), -10, 1e-9);
}

// The weight of a kernel is the slope of its cost; both start as the square does.
TEST(Robust, WeightsAreSlopes) {
  for (const double s : {0.0, 0.5, 3.0, 40.0}) {
    const auto slope = [&](auto kernel) { return (kernel(s + kStep).cost - kernel(s - kStep).cost) / (2 * kStep); };
    EXPECT_NEAR(slope([](double v) { return GemanMcClure(v, 9.0); }), GemanMcClure(s, 9.0).weight, kTolerance);
    EXPECT_NEAR(slope([](double v) { return Charbonnier(v); }), Charbonnier(s).weight, kTolerance);
  }
  EXPECT_EQ(GemanMcClure(0.0, 9.0).weight, 1);
  EXPECT_EQ(Charbonnier(0.0).weight, 1);
}

// Half a turn about an axis, known in closed form; and lanes do what doubles do.
TEST(Rotation, SeriesReachHalfATurn) {
  const double pi = std::acos(-1.0);
  const Point p = RotationOf(Point{0, 0, pi}) * Point{1, 2, 3};
  EXPECT_NEAR(p.x, -1, 1e-5);
  EXPECT_NEAR(p.y, -2, 1e-5);
  EXPECT_NEAR(p.z, 3, 1e-5);
  const Triple<Lanes> w{AllLanes(0.3F), AllLanes(-0.4F), AllLanes(0.5F)};
  const Rotation<Lanes> lanes = RotationOf(w);
  const Rotation<double> exact = RotationOf(Point{0.3, -0.4, 0.5});
  for (int row = 0; row < 3; ++row) EXPECT_NEAR(lanes.row[row].y[5], exact.row[row].y, 1e-6);
}

}  // namespace
}  // namespace depthtween
