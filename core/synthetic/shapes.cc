#include "core/synthetic/shapes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace depthtween {
namespace {

// The part of a ray inside an axis-aligned box; empty when enter > leave. Zero direction components give infinities of
// the right sign; a ray that lies exactly in a face's plane gives NaN, which every comparison leaves aside.
struct Span {
  double enter = 0.0, leave = 0.0;
  int axis = 0;  // of the face where the ray enters
};

Span ClipToBox(const Vec3& origin, const Vec3& inverse_direction, const Vec3& low, const Vec3& high) {
  Span span{-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(), 0};
  for (int axis = 0; axis < 3; ++axis) {
    const double inverse = inverse_direction[axis];
    double a = (low[axis] - origin[axis]) * inverse, b = (high[axis] - origin[axis]) * inverse;
    if (a > b) std::swap(a, b);
    if (a > span.enter) {
      span.enter = a;
      span.axis = axis;
    }
    span.leave = b < span.leave ? b : span.leave;
  }
  return span;
}

}  // namespace

bool Box::Intersect(const Ray& ray, double s_max, ShapeHit* hit) const {
  const Span span = ClipToBox(ray.origin, ray.direction.cwiseInverse(), -half_, half_);
  if (!(span.enter <= span.leave) || span.enter <= 0 || span.enter >= s_max) return false;
  hit->s = span.enter;
  hit->material = ray.origin + span.enter * ray.direction;
  hit->normal = Vec3::Zero();
  hit->normal[span.axis] = ray.direction[span.axis] > 0 ? -1.0 : 1.0;
  return true;
}

Vec2 Box::PatternCoordinates(const Vec3& m, const Vec3& normal) const {
  if (normal.z() != 0) return {m.x(), m.y()};
  if (normal.y() != 0) return {m.x(), m.z()};
  return {m.y(), m.z()};
}

bool Ellipsoid::Intersect(const Ray& ray, double s_max, ShapeHit* hit) const {
  const Vec3 o = ray.origin.cwiseQuotient(radii_), d = ray.direction.cwiseQuotient(radii_);
  const double dd = d.squaredNorm(), od = o.dot(d);
  // The squared distance of the line from the centre is computed as such: o.o - od^2/dd cancels when the origin is far.
  const double gap2 = (o - (od / dd) * d).squaredNorm();
  if (gap2 > 1) return false;
  const double s = -(od + std::sqrt(dd * (1 - gap2))) / dd;
  if (s <= 0 || s >= s_max) return false;
  hit->s = s;
  hit->material = ray.origin + s * ray.direction;
  hit->normal = hit->material.cwiseQuotient(radii_).cwiseQuotient(radii_);
  return true;
}

Vec2 Ellipsoid::PatternCoordinates(const Vec3& m, const Vec3&) const {
  const Vec3 unit = m.cwiseQuotient(radii_);
  return {std::atan2(unit.y(), unit.x()) * radii_.x(), std::asin(std::clamp(unit.z(), -1.0, 1.0)) * radii_.z()};
}

bool RoundCone::Intersect(const Ray& ray, double s_max, ShapeHit* hit) const {
  // The hull is two spheres and the piece of cone that touches both; its entry is the nearest entry of the three.
  // Source of the cone's quadratic: Quilez, "intersectors", round cone.
  const double scale = ray.direction.norm();
  const Vec3 d = ray.direction / scale;
  const Vec3& oa = ray.origin;
  const Vec3 ob = oa - Vec3(0, 0, length_);
  // Most rays that come here pass a thin rod at a distance: that of the two lines decides, before any root is taken.
  const double across = oa.x() * d.y() - oa.y() * d.x(), reach = std::max(radius_a_, radius_b_);
  if (across * across > reach * reach * d.head<2>().squaredNorm()) return false;
  const double da = d.dot(oa), db = d.dot(ob);
  double nearest = s_max * scale;
  bool found = false;
  const auto sphere = [&](const Vec3& o, double od, double radius) {
    const double gap2 = (o - od * d).squaredNorm();
    if (gap2 > radius * radius) return;
    const double s = -od - std::sqrt(radius * radius - gap2);
    if (s <= 0 || s >= nearest) return;
    nearest = s;
    found = true;
    hit->normal = o + s * d;
  };
  sphere(oa, da, radius_a_);
  sphere(ob, db, radius_b_);

  const double rr = radius_a_ - radius_b_;
  const double baba = length_ * length_, baoa = length_ * oa.z(), bard = length_ * d.z();
  const double d2 = baba - rr * rr;
  const double k2 = d2 - bard * bard;
  const double k1 = d2 * da - baoa * bard + bard * rr * radius_a_;
  const double k0 = d2 * oa.squaredNorm() - baoa * baoa + 2 * baoa * rr * radius_a_ - baba * radius_a_ * radius_a_;
  const double h = k1 * k1 - k0 * k2;
  if (h >= 0 && k2 != 0) {
    const double root = std::sqrt(h);
    for (const double s : {(-k1 - root) / k2, (-k1 + root) / k2}) {
      const double y = baoa - radius_a_ * rr + s * bard;  // along the axis, in units where the cone's piece is (0, d2)
      if (s <= 0 || s >= nearest || y <= 0 || y >= d2) continue;
      nearest = s;
      found = true;
      hit->normal = d2 * (oa + s * d) - y * Vec3(0, 0, length_);
    }
  }
  if (!found) return false;
  hit->s = nearest / scale;
  hit->material = ray.origin + nearest * d;
  // Entering means against the normal; the far side alone is met only by a ray that starts inside.
  return hit->normal.dot(d) < 0;
}

Eigen::AlignedBox3d RoundCone::Bounds() const {
  const double reach = std::max(radius_a_, radius_b_);
  return {Vec3(-reach, -reach, -radius_a_), Vec3(reach, reach, length_ + radius_b_)};
}

Vec2 RoundCone::PatternCoordinates(const Vec3& m, const Vec3&) const {
  return {std::atan2(m.y(), m.x()) * 0.5 * (radius_a_ + radius_b_), m.z()};
}

bool Cylinder::Intersect(const Ray& ray, double s_max, ShapeHit* hit) const {
  const Vec2 o = ray.origin.head<2>(), d = ray.direction.head<2>();
  const double dd = d.squaredNorm();
  double enter = -std::numeric_limits<double>::infinity();
  double leave = std::numeric_limits<double>::infinity();
  bool enters_side = false;
  if (dd > 0) {
    const double od = o.dot(d);
    const double gap2 = (o - (od / dd) * d).squaredNorm();
    if (gap2 > radius_ * radius_) return false;
    const double root = std::sqrt(dd * (radius_ * radius_ - gap2));
    enter = (-od - root) / dd;
    leave = (-od + root) / dd;
    enters_side = true;
  } else if (o.squaredNorm() > radius_ * radius_) {
    return false;
  }
  const double inverse = 1.0 / ray.direction.z();
  double a = (-half_height_ - ray.origin.z()) * inverse, b = (half_height_ - ray.origin.z()) * inverse;
  if (a > b) std::swap(a, b);
  if (a > enter) {
    enter = a;
    enters_side = false;
  }
  leave = std::min(leave, b);
  if (enter > leave || enter <= 0 || enter >= s_max) return false;
  hit->s = enter;
  hit->material = ray.origin + enter * ray.direction;
  hit->normal =
      enters_side ? Vec3(hit->material.x(), hit->material.y(), 0) : Vec3(0, 0, ray.direction.z() > 0 ? -1.0 : 1.0);
  return true;
}

Eigen::AlignedBox3d Cylinder::Bounds() const {
  const Vec3 half(radius_, radius_, half_height_);
  return {-half, half};
}

Vec2 Cylinder::PatternCoordinates(const Vec3& m, const Vec3& normal) const {
  if (normal.x() == 0 && normal.y() == 0) return {m.x(), m.y()};
  return {std::atan2(m.y(), m.x()) * radius_, m.z()};
}

SheetGrid::SheetGrid(int columns, int rows, double spacing_m, std::vector<Vec3> nodes)
    : columns_(columns), rows_(rows), spacing_m_(spacing_m), nodes_(std::move(nodes)) {
  node_normals_.reserve(nodes_.size());
  for (int j = 0; j <= rows_; ++j)
    for (int i = 0; i <= columns_; ++i) {
      const Vec3 along_u = Node(std::min(i + 1, columns_), j) - Node(std::max(i - 1, 0), j);
      const Vec3 along_v = Node(i, std::min(j + 1, rows_)) - Node(i, std::max(j - 1, 0));
      node_normals_.push_back(along_u.cross(along_v).normalized());
    }
  Level cells{columns_, rows_, {}};
  for (int j = 0; j < rows_; ++j)
    for (int i = 0; i < columns_; ++i) {
      const Vec3 &a = Node(i, j), &b = Node(i + 1, j), &c = Node(i, j + 1), &d = Node(i + 1, j + 1);
      Eigen::AlignedBox3d cell(a);
      cells.bounds.push_back(cell.extend(b).extend(c).extend(d));
    }
  levels_.push_back(std::move(cells));
  while (levels_.back().bounds.size() > 1) {
    const Level& below = levels_.back();
    Level level{(below.columns + 1) / 2, (below.rows + 1) / 2, {}};
    for (int j = 0; j < level.rows; ++j)
      for (int i = 0; i < level.columns; ++i) {
        Eigen::AlignedBox3d joined = below.bounds[2 * j * below.columns + 2 * i];
        for (int y = 2 * j; y < std::min(2 * j + 2, below.rows); ++y)
          for (int x = 2 * i; x < std::min(2 * i + 2, below.columns); ++x)
            joined.extend(below.bounds[y * below.columns + x]);
        level.bounds.push_back(joined);
      }
    levels_.push_back(std::move(level));
  }
}

bool SheetGrid::Intersect(const Ray& ray, double s_max, ShapeHit* hit) const {
  const Vec3 inverse_direction = ray.direction.cwiseInverse();
  struct Entry {
    int level, column, row;
  };
  std::array<Entry, 64> stack;  // depth first: at most 3 waiting entries per level and 4 at the last
  int size = 0;
  stack[size++] = {static_cast<int>(levels_.size()) - 1, 0, 0};
  bool found = false;
  while (size > 0) {
    const Entry entry = stack[--size];
    const Level& level = levels_[entry.level];
    const Eigen::AlignedBox3d& bounds = level.bounds[entry.row * level.columns + entry.column];
    // Flat cells have boxes without thickness; a hair of margin keeps rays through them.
    const Vec3 margin = Vec3::Constant(1e-9);
    const Span span = ClipToBox(ray.origin, inverse_direction, bounds.min() - margin, bounds.max() + margin);
    if (!(span.enter <= span.leave) || span.leave <= 0 || span.enter >= s_max) continue;
    if (entry.level == 0) {
      found |= IntersectCell(ray, entry.column, entry.row, &s_max, hit);
      continue;
    }
    const Level& below = levels_[entry.level - 1];
    for (int y = 2 * entry.row; y < std::min(2 * entry.row + 2, below.rows); ++y)
      for (int x = 2 * entry.column; x < std::min(2 * entry.column + 2, below.columns); ++x)
        stack[size++] = {entry.level - 1, x, y};
  }
  return found;
}

bool SheetGrid::IntersectCell(const Ray& ray, int column, int row, double* s_max, ShapeHit* hit) const {
  // Moeller-Trumbore on both halves. The halves share their diagonal, so a tolerance of 1e-9 leaves no crack.
  constexpr double kEdge = 1e-9;
  bool found = false;
  const auto triangle = [&](const Vec3& corner, const Vec3& to_u, const Vec3& to_v, double* a, double* b) {
    const Vec3 e1 = to_u - corner, e2 = to_v - corner;
    const Vec3 p = ray.direction.cross(e2);
    const double determinant = e1.dot(p);
    if (determinant == 0) return false;
    const Vec3 t = ray.origin - corner;
    *a = t.dot(p) / determinant;
    if (*a < -kEdge || *a > 1 + kEdge) return false;
    const Vec3 q = t.cross(e1);
    *b = ray.direction.dot(q) / determinant;
    if (*b < -kEdge || *a + *b > 1 + kEdge) return false;
    const double s = e2.dot(q) / determinant;
    if (s <= 0 || s >= *s_max) return false;
    *s_max = s;
    return true;
  };
  const Vec3 &p00 = Node(column, row), &p10 = Node(column + 1, row);
  const Vec3 &p01 = Node(column, row + 1), &p11 = Node(column + 1, row + 1);
  double a = 0, b = 0, u = 0, v = 0;
  if (triangle(p00, p10, p01, &a, &b)) {
    u = column + a;
    v = row + b;
    found = true;
  }
  if (triangle(p11, p01, p10, &a, &b)) {
    u = column + 1 - a;
    v = row + 1 - b;
    found = true;
  }
  if (!found) return false;
  hit->s = *s_max;
  hit->material = {u * spacing_m_, v * spacing_m_, 0};
  hit->normal = SmoothNormal(u, v);
  return true;
}

Vec3 SheetGrid::SmoothNormal(double u, double v) const {
  const int i = std::clamp(static_cast<int>(u), 0, columns_ - 1), j = std::clamp(static_cast<int>(v), 0, rows_ - 1);
  const double a = u - i, b = v - j;
  const auto normal = [&](int column, int row) -> const Vec3& { return node_normals_[row * (columns_ + 1) + column]; };
  return (1 - b) * ((1 - a) * normal(i, j) + a * normal(i + 1, j)) +
         b * ((1 - a) * normal(i, j + 1) + a * normal(i + 1, j + 1));
}

Vec3 SheetGrid::Locate(const Vec3& material) const {
  const double u = material.x() / spacing_m_, v = material.y() / spacing_m_;
  const int i = std::clamp(static_cast<int>(u), 0, columns_ - 1), j = std::clamp(static_cast<int>(v), 0, rows_ - 1);
  const double a = u - i, b = v - j;
  if (a + b <= 1) return Node(i, j) + a * (Node(i + 1, j) - Node(i, j)) + b * (Node(i, j + 1) - Node(i, j));
  const Vec3& far = Node(i + 1, j + 1);
  return far + (1 - a) * (Node(i, j + 1) - far) + (1 - b) * (Node(i + 1, j) - far);
}

}  // namespace depthtween
