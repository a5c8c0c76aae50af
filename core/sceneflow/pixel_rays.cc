#include "core/sceneflow/pixel_rays.h"

#include <cmath>

namespace depthtween {

PixelRays::PixelRays(const Camera& camera)
    : camera_(camera),
      distorted_(camera.HasDistortion()),
      fx_(static_cast<float>(camera.fx)),
      fy_(static_cast<float>(camera.fy)),
      cx_(static_cast<float>(camera.cx)),
      cy_(static_cast<float>(camera.cy)),
      focal_px_(static_cast<float>(std::sqrt(camera.fx * camera.fy))),
      rays_(camera.width, camera.height) {
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Vec3 ray = camera.Unproject(Vec2(x, y), 1.0);
      rays_(x, y) = {static_cast<float>(ray.x()), static_cast<float>(ray.y())};
    }
}

Float3 PixelRays::PointAt(float x, float y, float z) const {
  if (!distorted_) return {(x - cx_) / fx_ * z, (y - cy_) / fy_ * z, z};
  const Vec3 point = camera_.Unproject(Vec2(x, y), z);
  return {static_cast<float>(point.x()), static_cast<float>(point.y()), z};
}

Flow2 PixelRays::ProjectDistorted(const Float3& point) const {
  const Vec2 pixel = camera_.Project(Vec3(point.x, point.y, point.z));
  return {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
}

}  // namespace depthtween
