// Whether stored depth is in the units that camera.json says.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_DEPTH_SCALE_H_
#define DEPTHTWEEN_CORE_SEQUENCE_DEPTH_SCALE_H_

#include <optional>
#include <string>

namespace depthtween {

// A warning when depth read by `depth_scale` (units per metre) is nearer than 0.1 m or farther than 30 m in the median:
// says the median, and every scale in use that would make it that of a room, each with the median that it implies. None
// for a median of 0: nothing was measured.
std::optional<std::string> ImplausibleDepthScale(double median_depth_m, double depth_scale);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_DEPTH_SCALE_H_
