#include "core/sequence/depth_scale.h"

#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace depthtween {
namespace {

// Where indoor depth cameras look, with room to spare: the Kinect v2 sees 0.5 to 4.5 m, RealSense from 0.1 m.
constexpr double kMinPlausibleMedianM = 0.1;
constexpr double kMaxPlausibleMedianM = 30.0;

// Every scale in use that would make the median that of a room, each with the median that it implies.
std::string PlausibleScales(double median_units) {
  // What cameras and datasets use: centimetres, KITTI, millimetres (most), RealSense L515, TUM RGB-D, tenths of a
  // millimetre, hundredths.
  std::vector<std::string> plausible;
  for (const double scale : {100.0, 256.0, 1000.0, 4000.0, 5000.0, 10000.0, 100000.0}) {
    const double median_m = median_units / scale;
    if (median_m >= 0.3 && median_m <= 10.0)
      plausible.push_back(absl::StrFormat("%.6g (median %.4g m)", scale, median_m));
  }
  if (plausible.empty()) return "check how many units a metre has";
  return absl::StrCat("plausible units per metre: ", absl::StrJoin(plausible, ", "));
}

}  // namespace

std::optional<std::string> ImplausibleDepthScale(double median_depth_m, double depth_scale) {
  if (median_depth_m <= 0 || (median_depth_m >= kMinPlausibleMedianM && median_depth_m <= kMaxPlausibleMedianM))
    return std::nullopt;
  return absl::StrFormat("camera.depth_scale = %g is implausible: it implies a median depth of %.4g m; %s", depth_scale,
                         median_depth_m, PlausibleScales(median_depth_m * depth_scale));
}

}  // namespace depthtween
