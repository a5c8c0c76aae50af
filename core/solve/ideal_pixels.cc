#include "core/solve/ideal_pixels.h"

namespace depthtween {

IdealPixels::IdealPixels(const Camera& camera)
    : camera_(camera),
      pinhole_{static_cast<float>(camera.fx), static_cast<float>(camera.fy), static_cast<float>(camera.cx),
               static_cast<float>(camera.cy)} {
  if (!camera.HasDistortion()) return;
  shift_u_ = Image<float>(camera.width, camera.height);
  shift_v_ = Image<float>(camera.width, camera.height);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Vec3 ray = camera.Unproject({x, y}, 1.0);
      shift_u_(x, y) = static_cast<float>(camera.fx * ray.x() + camera.cx - x);
      shift_v_(x, y) = static_cast<float>(camera.fy * ray.y() + camera.cy - y);
    }
}

PixelOf<float> IdealPixels::Ideal(float x, float y) const {
  if (shift_u_.empty()) return {x, y};
  return {x + SampleBilinear(shift_u_, x, y), y + SampleBilinear(shift_v_, x, y)};
}

PixelOf<float> IdealPixels::Seen(float u, float v) const {
  if (shift_u_.empty()) return {u, v};
  const Vec2 pixel = camera_.Project({(u - pinhole_.cx) / pinhole_.fx, (v - pinhole_.cy) / pinhole_.fy, 1.0});
  return {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
}

Triple<float> IdealPixels::PointAt(float x, float y, float z) const {
  const PixelOf<float> ideal = Ideal(x, y);
  return {(ideal.u - pinhole_.cx) / pinhole_.fx * z, (ideal.v - pinhole_.cy) / pinhole_.fy * z, z};
}

}  // namespace depthtween
