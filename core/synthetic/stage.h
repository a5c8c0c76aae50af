// What the scenes share: placing things, periodic movement, a room with lamps.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_STAGE_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_STAGE_H_

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/synthetic/scene.h"

namespace depthtween {

constexpr double kPi = 3.14159265358979323846;

Affine At(double x, double y, double z);
Affine Turn(const Vec3& axis, double angle_rad);
// Moves the z axis of a part onto the segment from `a` towards `b`, its origin to `a`.
Affine AlongSegment(const Vec3& a, const Vec3& b);
// A camera at `eye` that looks at `target`, upright.
Pose LookAt(const Vec3& eye, const Vec3& target);

std::shared_ptr<const Shape> MakeBox(double width, double depth, double height);  // full extents along x, y, z
std::shared_ptr<const Shape> MakeBall(double radius);
std::shared_ptr<const Shape> MakeEllipsoid(double rx, double ry, double rz);
std::shared_ptr<const Shape> MakeLimb(double length, double radius_at_origin, double radius_at_end);
std::shared_ptr<const Shape> MakeCylinder(double radius, double height);

// A periodic curve through (time, value) points, times ascending within [0, period): cubic Hermite with the slopes of
// Catmull and Rom for uneven times.
class PeriodicCurve {
 public:
  PeriodicCurve(double period, std::vector<std::pair<double, double>> points)
      : period_(period), points_(std::move(points)) {}
  double operator()(double time) const;

 private:
  double period_;
  std::vector<std::pair<double, double>> points_;
};

struct RoomStyle {
  double width = 5.0, back = 4.6, height = 2.9;  // metres; the back wall stands at y = back
  Paint floor, back_wall, side_wall;
};
// Floor at z = 0, back wall, side walls, ceiling, and three lamps under it.
void AddRoom(Scene& scene, const RoomStyle& style);

// Static single-part bodies.
void AddProp(Scene& scene, std::string name, std::shared_ptr<const Shape> shape, const Affine& place,
             const Paint& paint);
// A post or rung from a to b.
void AddRod(Scene& scene, int body, const Vec3& a, const Vec3& b, double radius, const Paint& paint);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_STAGE_H_
