#include "core/render/lens.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace depthtween {
namespace {

constexpr struct Sensor {
  std::string_view name;
  double width_mm;
} kSensors[] = {{"full-frame", 36.0}, {"medium-format", 43.8},     {"super-35", 24.9},
                {"aps-c", 23.6},      {"micro-four-thirds", 17.3}, {"one-inch", 13.2}};

const Sensor* FindSensor(std::string_view name) {
  const auto* found = std::find_if(std::begin(kSensors), std::end(kSensors), [&](auto& s) { return s.name == name; });
  return found == std::end(kSensors) ? nullptr : found;
}

absl::Status FieldError(const char* field, double value, const std::string& rule) {
  return absl::InvalidArgumentError(absl::StrFormat("%s = %g, must be %s", field, value, rule));
}

}  // namespace

absl::Status LensOptions::Validate() const {
  // Written so that NaN fails.
  if (!(focal_mm == 0 || (focal_mm >= 1 && focal_mm <= 2000)))
    return FieldError("focal_mm", focal_mm, "between 1 and 2000, or 0 to have it follow from the sensor");
  if (!(fstop >= 0.5 && fstop <= 64)) return FieldError("fstop", fstop, "between 0.5 and 64");
  if (!(aperture_mm >= 0 && aperture_mm <= 1000))
    return FieldError("aperture_mm", aperture_mm, "between 0 and 1000, where 0 means focal length / f-stop");
  if (FindSensor(sensor) == nullptr) {
    const std::string names =
        absl::StrJoin(kSensors, ", ", [](std::string* out, const Sensor& s) { out->append(s.name); });
    return absl::InvalidArgumentError(absl::StrFormat("sensor = '%s', must be one of: %s", sensor, names));
  }
  return absl::OkStatus();
}

absl::StatusOr<CircleOfConfusion> MakeCircleOfConfusion(const Camera& camera, const LensOptions& lens, double focus_m) {
  RETURN_IF_ERROR(lens.Validate());
  const double own_focal_mm = camera.fx / std::max(camera.width, camera.height) * FindSensor(lens.sensor)->width_mm;
  const double focal_mm = lens.focal_mm > 0 ? lens.focal_mm : own_focal_mm;
  const double aperture_mm = lens.aperture_mm > 0 ? lens.aperture_mm : focal_mm / lens.fstop;
  const double behind_focal_mm = 1000 * focus_m - focal_mm;
  if (!(behind_focal_mm > 0 && std::isfinite(focus_m)))
    return FieldError("focus_m", focus_m,
                      absl::StrFormat("a finite distance beyond the lens's focal length of %g m", focal_mm / 1000));
  return CircleOfConfusion{camera.fx * aperture_mm / (2 * behind_focal_mm), focus_m};
}

}  // namespace depthtween
