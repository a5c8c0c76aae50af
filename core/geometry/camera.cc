#include "core/geometry/camera.h"

#include <cmath>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

// 2^15 on a side and 64 megapixels: what the rest of the code promises to hold in 32-bit pixel indices and in memory.
constexpr int kMaxSide = 32768;
constexpr double kMaxMegapixels = 64e6;

Vec2 Distort(const Camera& c, const Vec2& n) {
  const double x = n.x(), y = n.y(), r2 = x * x + y * y;
  const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  return {x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x),
          y * radial + c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y};
}

absl::Status FieldError(const char* field, double value, const char* rule) {
  return absl::InvalidArgumentError(absl::StrFormat("camera.%s = %g, must be %s", field, value, rule));
}

}  // namespace

absl::Status Camera::Validate() const {
  if (width < 1 || width > kMaxSide) return FieldError("width", width, "between 1 and 32768");
  if (height < 1 || height > kMaxSide) return FieldError("height", height, "between 1 and 32768");
  if (static_cast<double>(width) * height > kMaxMegapixels)
    return absl::ResourceExhaustedError(
        absl::StrFormat("camera.width x camera.height = %d x %d, must be at most 64 megapixels", width, height));
  const double longest = std::max(width, height);
  for (auto [name, value] : {std::pair{"fx", fx}, std::pair{"fy", fy}}) {
    if (!std::isfinite(value) || value <= 0) return FieldError(name, value, "a positive number of pixels");
    if (value < 0.05 * longest || value > 200 * longest)
      return FieldError(name, value, "between 0.05 and 200 times the image's longer side (pixels, not millimetres)");
  }
  for (auto [name, value] : {std::pair{"cx", cx}, std::pair{"cy", cy}}) {
    if (!std::isfinite(value)) return FieldError(name, value, "a finite number of pixels");
    if (std::abs(value) > 10 * longest) return FieldError(name, value, "within 10 image sides of the image");
  }
  for (auto [name, value] :
       {std::pair{"k1", k1}, std::pair{"k2", k2}, std::pair{"p1", p1}, std::pair{"p2", p2}, std::pair{"k3", k3}}) {
    if (!std::isfinite(value)) return FieldError(name, value, "finite");
  }
  return absl::OkStatus();
}

Vec2 Camera::Project(const Vec3& point) const {
  Vec2 n(point.x() / point.z(), point.y() / point.z());
  if (HasDistortion()) n = Distort(*this, n);
  return {fx * n.x() + cx, fy * n.y() + cy};
}

Vec3 Camera::Unproject(const Vec2& pixel, double z) const {
  const Vec2 distorted((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Vec2 n = distorted;
  if (HasDistortion()) {
    // Fixed point n <- n + (d - Distort(n)); 20 rounds reach 1e-9 for the lenses of the consumer cameras we support.
    for (int i = 0; i < 20; ++i) n += distorted - Distort(*this, n);
  }
  return {n.x() * z, n.y() * z, z};
}

}  // namespace depthtween
