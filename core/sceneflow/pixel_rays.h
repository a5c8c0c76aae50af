// A camera's rays as a table: points of pixels and pixels of points, in single precision.
//
// Units:    pixels and metres.  Threads: immutable; safe to use concurrently.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_PIXEL_RAYS_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_PIXEL_RAYS_H_

#include <algorithm>

#include "core/base/float3.h"
#include "core/base/image.h"
#include "core/geometry/camera.h"

namespace depthtween {

class PixelRays {
 public:
  // `camera` must be valid.
  explicit PixelRays(const Camera& camera);

  const Camera& camera() const { return camera_; }
  int width() const { return rays_.width(); }
  int height() const { return rays_.height(); }
  float focal_px() const { return focal_px_; }

  // The point at depth z seen at a pixel.
  Float3 Point(int x, int y, float z) const {
    const Flow2 ray = rays_(x, y);
    return {ray.u * z, ray.v * z, z};
  }
  // The same between pixels and outside the image.
  Float3 PointAt(float x, float y, float z) const;
  // Where a point is seen. Points not in front of the camera are seen far outside the image.
  Flow2 Project(const Float3& point) const {
    if (!(point.z > kNearestZ)) return {kFarOutside, kFarOutside};
    if (distorted_) return ProjectDistorted(point);
    return {fx_ * point.x / point.z + cx_, fy_ * point.y / point.z + cy_};
  }
  bool Inside(const Flow2& place) const {
    return place.u >= -0.5F && place.v >= -0.5F && place.u < static_cast<float>(width()) - 0.5F &&
           place.v < static_cast<float>(height()) - 0.5F;
  }

 private:
  static constexpr float kNearestZ = 1e-4F;
  static constexpr float kFarOutside = -1e6F;

  Flow2 ProjectDistorted(const Float3& point) const;

  const Camera camera_;
  const bool distorted_;
  const float fx_, fy_, cx_, cy_, focal_px_;
  Image<Flow2> rays_;  // x / z and y / z
};

inline Float3 operator+(const Float3& a, const Float3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Float3 operator-(const Float3& a, const Float3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Float3 operator*(float s, const Float3& a) { return {s * a.x, s * a.y, s * a.z}; }

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_PIXEL_RAYS_H_
