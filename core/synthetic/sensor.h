// What cameras make of a perfect picture: noise, mixed and missing pixels, quantisation, clocks that disagree.
//
// Every random number is a function of (seed, frame, pixel): the same options give the same recording on any number of
// threads and whatever is rendered first.
// Threads: all functions are pure.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_SENSOR_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_SENSOR_H_

#include <cstdint>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/synthetic/render.h"

namespace depthtween {

struct SensorModel {
  // Depth: standard deviation a + b z^2 along the ray's z.
  double noise_a_m = 0.0;
  double noise_b_per_m = 0.0;
  // Of the pixels beside a depth edge: the share whose depth is a mixture of both sides ("flying pixels"), and the
  // share around which a patch of 1 or 2 pixels a side is missing.
  double flying_share = 0.0;
  double edge_dropout_share = 0.0;
  double random_dropout_share = 0.0;  // of all pixels
  // Below this echo (albedo x cosine of incidence, fading with depth as (2 m / z)^2) nothing comes back; up to twice of
  // it, something comes back ever more often.
  double least_echo = 0.0;
  double quantum_m = 0.0;  // depth is a multiple of this; 0 = exact
  // Colour: standard deviation in 8-bit levels in the dark, and what the square root of the level adds.
  double color_noise_levels = 0.0;
  double color_shot_noise = 0.0;

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// No noise at all.
SensorModel PerfectSensor();
// A time-of-flight camera of the Kinect v2's kind.
SensorModel Kinect2Sensor();
// By name: "kinect2" or "none"; InvalidArgument otherwise.
absl::StatusOr<SensorModel> SensorByName(std::string_view name);

// A pixel lies beside a depth edge if one of its eight neighbours is farther away or nearer by more than this.
inline constexpr float kDepthEdgeM = 0.05F;

// The measured depth map; 0 = missing. `frame` is the depth frame's index.
Image<float> MeasureDepth(const SensorModel& model, const SurfaceTruth& truth, uint64_t seed, int frame);
// The recorded picture.
Image<Rgb8> MeasureColor(const SensorModel& model, ImageView<const Rgb8> perfect, uint64_t seed, int frame);

// The depth camera's clock against the colour camera's. Stamps of depth frames are read off it, truth is not.
struct DepthClock {
  double offset_s = 0.0;   // what it shows when the colour camera's shows 0
  double drift_ppm = 0.0;  // microseconds that it gains in a second
  double Reading(double color_clock_s) const { return offset_s + (1 + 1e-6 * drift_ppm) * color_clock_s; }
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_SENSOR_H_
