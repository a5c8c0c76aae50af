// A pinhole camera with Brown-Conrady distortion: pixel <-> ray <-> point.
//
// Camera frame: x right, y down, z forward, metres. Integer pixel coordinate = pixel centre. Depth is z, not range.
// Source: distortion as in OpenCV calib3d and the TUM RGB-D documentation (k1 k2 p1 p2 k3).
#ifndef DEPTHTWEEN_CORE_GEOMETRY_CAMERA_H_
#define DEPTHTWEEN_CORE_GEOMETRY_CAMERA_H_

#include <Eigen/Core>
#include <string>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;

struct Camera {
  int width = 0, height = 0;                      // pixels
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  // pixels
  double k1 = 0.0, k2 = 0.0, p1 = 0.0, p2 = 0.0, k3 = 0.0;

  bool HasDistortion() const { return k1 != 0 || k2 != 0 || p1 != 0 || p2 != 0 || k3 != 0; }

  // InvalidArgument with the field, its value and the rule.
  absl::Status Validate() const;

  // What is valid but hardly true, in sentences for people with the likely cause: a principal point outside the image
  // or far from its centre, a field of view that cameras do not have. Empty for an invalid camera.
  std::vector<std::string> Doubts() const;

  // The pixel where a point (z > 0) is seen; it may lie outside the image.
  Vec2 Project(const Vec3& point) const;
  // The point at depth z (metres) seen at a pixel. Undoes distortion by fixed-point iteration.
  Vec3 Unproject(const Vec2& pixel, double z) const;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_GEOMETRY_CAMERA_H_
