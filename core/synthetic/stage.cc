#include "core/synthetic/stage.h"

#include <algorithm>
#include <cmath>

namespace depthtween {

Affine At(double x, double y, double z) { return Affine(Eigen::Translation3d(x, y, z)); }

Affine Turn(const Vec3& axis, double angle_rad) { return Affine(Eigen::AngleAxisd(angle_rad, axis)); }

Affine AlongSegment(const Vec3& a, const Vec3& b) {
  return Eigen::Translation3d(a) * Affine(Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(), b - a));
}

Pose LookAt(const Vec3& eye, const Vec3& target) {
  const Vec3 forward = (target - eye).normalized();
  const Vec3 right = forward.cross(Vec3::UnitZ()).normalized();
  Pose pose = Pose::Identity();
  pose.linear() << right, forward.cross(right), forward;
  pose.translation() = eye;
  return pose;
}

std::shared_ptr<const Shape> MakeBox(double width, double depth, double height) {
  return std::make_shared<Box>(0.5 * Vec3(width, depth, height));
}
std::shared_ptr<const Shape> MakeBall(double radius) { return std::make_shared<Ellipsoid>(Vec3::Constant(radius)); }
std::shared_ptr<const Shape> MakeEllipsoid(double rx, double ry, double rz) {
  return std::make_shared<Ellipsoid>(Vec3(rx, ry, rz));
}
std::shared_ptr<const Shape> MakeLimb(double length, double radius_at_origin, double radius_at_end) {
  return std::make_shared<RoundCone>(length, radius_at_origin, radius_at_end);
}
std::shared_ptr<const Shape> MakeCylinder(double radius, double height) {
  return std::make_shared<Cylinder>(radius, 0.5 * height);
}

double PeriodicCurve::operator()(double time) const {
  const int count = static_cast<int>(points_.size());
  const double phase = time - period_ * std::floor(time / period_);
  // Points before and after, counted beyond either end by whole periods.
  const auto point = [&](int i) {
    const int turns = i < 0 ? -1 : i / count;
    const auto& [t, value] = points_[i - turns * count];
    return std::pair{t + turns * period_, value};
  };
  int after = 0;
  while (after < count && points_[after].first <= phase) ++after;
  const auto [t0, p0] = point(after - 1);
  const auto [t1, p1] = point(after);
  const auto slope = [&](int i) {
    const auto [ta, a] = point(i - 1);
    const auto [tb, b] = point(i + 1);
    return (b - a) / (tb - ta);
  };
  const double span = t1 - t0, x = (phase - t0) / span;
  const double m0 = slope(after - 1) * span, m1 = slope(after) * span;
  return p0 + x * (m0 + x * (3 * (p1 - p0) - 2 * m0 - m1 + x * (2 * (p0 - p1) + m0 + m1)));
}

void AddRoom(Scene& scene, const RoomStyle& style) {
  constexpr double kThick = 0.1, kFront = -3.0;
  const double depth = style.back - kFront, middle = 0.5 * (style.back + kFront);
  const int floor = scene.AddBody("floor");
  scene.AddPart(floor, MakeBox(style.width, depth, kThick), At(0, middle, -0.5 * kThick), style.floor, false);
  const int back = scene.AddBody("back wall");
  scene.AddPart(back, MakeBox(style.width, kThick, style.height), At(0, style.back + 0.5 * kThick, 0.5 * style.height),
                style.back_wall, false);
  // A skirting board, so that the seam is not a knife's edge.
  AddProp(scene, "skirting", MakeBox(style.width, 0.03, 0.09), At(0, style.back - 0.015, 0.045),
          {.color = FromSrgb(0xE8E2D6), .grain = 0.05F});
  const int sides = scene.AddBody("side walls");
  for (const double side : {-1.0, 1.0})
    scene.AddPart(sides, MakeBox(kThick, depth, style.height),
                  At(side * 0.5 * (style.width + kThick), middle, 0.5 * style.height), style.side_wall, false);
  const int ceiling = scene.AddBody("ceiling");
  scene.AddPart(ceiling, MakeBox(style.width, depth, kThick), At(0, middle, style.height + 0.5 * kThick),
                {.pattern = Pattern::kTiles,
                 .color = FromSrgb(0xD8D6D0),
                 .second_color = FromSrgb(0xA8A49A),
                 .pattern_size_m = 0.6F,
                 .grain = 0.1F,
                 .grain_size_m = 0.05F,
                 .seed = style.floor.seed + 5},
                false);
  const double high = style.height - 0.15;
  scene.AddLamp({-0.30 * style.width, 0.30 * style.back, high}, 0.38F);
  scene.AddLamp({0.32 * style.width, 0.15 * style.back, high}, 0.30F);
  scene.AddLamp({0.05 * style.width, 0.70 * style.back, high}, 0.17F);
}

void AddProp(Scene& scene, std::string name, std::shared_ptr<const Shape> shape, const Affine& place,
             const Paint& paint) {
  scene.AddPart(scene.AddBody(std::move(name)), std::move(shape), place, paint);
}

void AddRod(Scene& scene, int body, const Vec3& a, const Vec3& b, double radius, const Paint& paint) {
  scene.AddPart(body, MakeLimb((b - a).norm(), radius, radius), AlongSegment(a, b), paint);
}

}  // namespace depthtween
