// A virtual lens in front of the colour camera, and how unsharp it shows what lies at a depth.
//
// The lens decides the opening alone: A = focal length / f-stop. The field of view stays the camera's, so the picture
// is cropped or widened as if the sensor had been made to fit.
#ifndef DEPTHTWEEN_CORE_RENDER_LENS_H_
#define DEPTHTWEEN_CORE_RENDER_LENS_H_

#include <algorithm>
#include <string>

#include "core/base/status.h"
#include "core/geometry/camera.h"

namespace depthtween {

struct LensOptions {
  double focal_mm = 0.0;     // 0: the focal length that has the camera's field of view on `sensor`
  double fstop = 1.8;        // 0.5..64
  double aperture_mm = 0.0;  // diameter of the opening; 0: focal length / f-stop
  // full-frame, medium-format, super-35, aps-c, micro-four-thirds or one-inch. Its width, along the picture's longer
  // side, decides the focal length where focal_mm does not.
  std::string sensor = "full-frame";

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// The image of a point is the aperture's shape, scaled by a signed radius rho(z) = R (1 - z_f / z), in pixels: linear
// in inverse depth, negative in front of the focus.
struct CircleOfConfusion {
  double scale_px = 0.0;  // R = f_px A / (2 (z_f - F)), the radius of what lies infinitely far away
  double focus_m = 1.0;   // z_f
  double limit_px = 128;  // larger radii are cut down to this

  // Unknown depth (0) is taken for infinitely far.
  float RadiusPx(float depth_m) const {
    const auto scale = static_cast<float>(scale_px), focus = static_cast<float>(focus_m);
    const auto limit = static_cast<float>(limit_px);
    return std::clamp(depth_m > 0 ? scale * (1 - focus / depth_m) : scale, -limit, limit);
  }
};

// Errors: InvalidArgument with the field: what Validate says, and focus_m unless it is farther than the focal length.
absl::StatusOr<CircleOfConfusion> MakeCircleOfConfusion(const Camera& camera, const LensOptions& lens, double focus_m);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_LENS_H_
