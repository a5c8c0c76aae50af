#include "core/geometry/camera.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

// 2^15 on a side and 64 megapixels: what the rest of the code promises to hold in 32-bit pixel indices and in memory.
constexpr int kMaxSide = 32768;
constexpr double kMaxMegapixels = 64e6;

constexpr double kDegreesPerRadian = 57.29577951308232;
// Telephoto lenses and fisheyes lie beyond; cameras with depth see 40 to 120 degrees.
constexpr double kNarrowestDeg = 15.0, kWidestDeg = 140.0;
// How far, as a ratio, a principal point may be from the centre: cropped images have it off the centre, but hardly by
// the same factor in x and in y.
constexpr double kMaxCentred = 1.5, kSameRatio = 0.1;
// Anamorphic binning makes 2; anything that is not square is worth a word.
constexpr double kMaxAspect = 1.5;

// The whole or half number, or one over it, that a ratio of resolutions is most likely meant to be: whether the middle
// of 640 pixels is called 320 or 319.5 must not make it 2.003.
double Simple(double ratio) {
  constexpr double kTolerance = 0.02;
  const bool enlarged = ratio < 1;
  const double halves = std::round(2 * (enlarged ? 1 / ratio : ratio)) / 2;
  const double simple = enlarged ? 1 / halves : halves;
  return std::abs(simple - ratio) < kTolerance * ratio ? simple : ratio;
}

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

std::vector<std::string> Camera::Doubts() const {
  if (!Validate().ok()) return {};
  std::vector<std::string> doubts;
  // 1 when the principal point is in the middle: intrinsics of an image n times as large make it n.
  const double ratio_x = (2 * cx + 1) / width, ratio_y = (2 * cy + 1) / height;
  const bool outside = cx < -0.5 || cy < -0.5 || cx > width - 0.5 || cy > height - 0.5;
  const double ratio = Simple((ratio_x + ratio_y) / 2);
  const bool same_ratio = ratio > 0 && std::abs(ratio_x - ratio_y) < kSameRatio * ratio;
  const bool scaled = same_ratio && (ratio > kMaxCentred || ratio < 1 / kMaxCentred);
  const double view_deg = 2 * std::atan(width / (2 * fx)) * kDegreesPerRadian;
  const bool odd_view = view_deg < kNarrowestDeg || view_deg > kWidestDeg;
  if (outside || scaled) {
    std::string text =
        absl::StrFormat("camera.json: the principal point (cx = %g, cy = %g) lies %s of %d x %d pixels", cx, cy,
                        outside ? "outside the image" : "far from the centre of the image", width, height);
    if (scaled) {
      absl::StrAppendFormat(&text,
                            ". It would be in the middle of one of %.0f x %.0f pixels: these look like the intrinsics "
                            "of that resolution. If so, divide fx, fy, cx and cy by %.4g (fx = %.5g, fy = %.5g, cx = "
                            "%.5g, cy = %.5g)",
                            ratio * width, ratio * height, ratio, fx / ratio, fy / ratio, (cx + 0.5) / ratio - 0.5,
                            (cy + 0.5) / ratio - 0.5);
    } else {
      absl::StrAppend(&text, ". Check cx and cy: they are pixels of this image, from its top left corner");
    }
    doubts.push_back(std::move(text));
  }
  if (odd_view && !scaled)
    doubts.push_back(absl::StrFormat(
        "camera.json: fx = %g for %d pixels of width is a field of view of %.3g degrees, which depth cameras do not "
        "have (%g to %g). Check that fx and fy are pixels of this resolution",
        fx, width, view_deg, kNarrowestDeg, kWidestDeg));
  if (const double aspect = fy / fx; aspect < 1 / kMaxAspect || aspect > kMaxAspect)
    doubts.push_back(
        absl::StrFormat("camera.json: fx = %g and fy = %g differ by a factor of %.3g, and pixels are about square: "
                        "check that both are of this resolution",
                        fx, fy, std::max(aspect, 1 / aspect)));
  return doubts;
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
