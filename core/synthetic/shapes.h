// The solids and sheets that scenes are made of, and where a ray meets them.
//
// A shape lives in its own frame, in metres. Every point of its surface has a material coordinate, which stays with the
// surface when it moves: for solids the point itself, for a sheet (u, v, 0) in metres along its warp and weft.
// Threads: shapes are immutable; all methods are safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_SHAPES_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_SHAPES_H_

#include <Eigen/Geometry>
#include <vector>

#include "core/geometry/camera.h"

namespace depthtween {

// Points origin + s * direction, s > 0. `direction` may have any length, so that s survives affine maps.
struct Ray {
  Vec3 origin, direction;
};

struct ShapeHit {
  double s = 0.0;
  Vec3 material = Vec3::Zero();
  Vec3 normal = Vec3::Zero();  // outward, any length; for a sheet towards the side of positive (u x v)
};

class Shape {
 public:
  virtual ~Shape() = default;
  // The first entry into the surface with 0 < s < s_max; false if there is none. Rays that start inside a solid miss
  // it.
  virtual bool Intersect(const Ray& ray, double s_max, ShapeHit* hit) const = 0;
  // The point of the surface with this material coordinate.
  virtual Vec3 Locate(const Vec3& material) const { return material; }
  // Metric coordinates along the surface, for patterns.
  virtual Vec2 PatternCoordinates(const Vec3& material, const Vec3& normal) const = 0;
  virtual Eigen::AlignedBox3d Bounds() const = 0;
};

// Centred on the origin, faces along the axes.
class Box : public Shape {
 public:
  explicit Box(const Vec3& half_extent) : half_(half_extent) {}
  bool Intersect(const Ray& ray, double s_max, ShapeHit* hit) const override;
  Vec2 PatternCoordinates(const Vec3& material, const Vec3& normal) const override;
  Eigen::AlignedBox3d Bounds() const override { return {-half_, half_}; }

 private:
  const Vec3 half_;
};

class Ellipsoid : public Shape {
 public:
  explicit Ellipsoid(const Vec3& radii) : radii_(radii) {}
  bool Intersect(const Ray& ray, double s_max, ShapeHit* hit) const override;
  Vec2 PatternCoordinates(const Vec3& material, const Vec3& normal) const override;
  Eigen::AlignedBox3d Bounds() const override { return {-radii_, radii_}; }

 private:
  const Vec3 radii_;
};

// The hull of a sphere at the origin and another at (0, 0, length): a tapered limb; a capsule where the radii are
// equal.
class RoundCone : public Shape {
 public:
  RoundCone(double length, double radius_at_origin, double radius_at_end)
      : length_(length), radius_a_(radius_at_origin), radius_b_(radius_at_end) {}
  bool Intersect(const Ray& ray, double s_max, ShapeHit* hit) const override;
  Vec2 PatternCoordinates(const Vec3& material, const Vec3& normal) const override;
  Eigen::AlignedBox3d Bounds() const override;

 private:
  const double length_, radius_a_, radius_b_;
};

// Centred on the origin, axis along z, with flat ends.
class Cylinder : public Shape {
 public:
  Cylinder(double radius, double half_height) : radius_(radius), half_height_(half_height) {}
  bool Intersect(const Ray& ray, double s_max, ShapeHit* hit) const override;
  Vec2 PatternCoordinates(const Vec3& material, const Vec3& normal) const override;
  Eigen::AlignedBox3d Bounds() const override;

 private:
  const double radius_, half_height_;
};

// A sheet of cloth at one instant: a grid of nodes, each cell two flat triangles, hit from both sides. The surface *is*
// the triangles, so moving a material coordinate from one instant's grid to another's is exact.
class SheetGrid : public Shape {
 public:
  // `nodes`: (columns + 1) x (rows + 1) points, row by row; neighbours are `spacing_m` apart in material coordinates.
  SheetGrid(int columns, int rows, double spacing_m, std::vector<Vec3> nodes);
  bool Intersect(const Ray& ray, double s_max, ShapeHit* hit) const override;
  Vec3 Locate(const Vec3& material) const override;
  Vec2 PatternCoordinates(const Vec3& material, const Vec3&) const override { return material.head<2>(); }
  Eigen::AlignedBox3d Bounds() const override { return levels_.back().bounds.front(); }

 private:
  // A pyramid over the cells: level 0 has one entry per cell, each further level one per 2 x 2 of the level below.
  struct Level {
    int columns, rows;
    std::vector<Eigen::AlignedBox3d> bounds;
  };
  const Vec3& Node(int column, int row) const { return nodes_[row * (columns_ + 1) + column]; }
  bool IntersectCell(const Ray& ray, int column, int row, double* s_max, ShapeHit* hit) const;
  Vec3 SmoothNormal(double u, double v) const;

  const int columns_, rows_;
  const double spacing_m_;
  const std::vector<Vec3> nodes_;
  std::vector<Vec3> node_normals_;
  std::vector<Level> levels_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_SHAPES_H_
