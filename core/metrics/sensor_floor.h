// What a real sensor disagrees with itself about: errors of this size say nothing about a method.
#ifndef DEPTHTWEEN_CORE_METRICS_SENSOR_FLOOR_H_
#define DEPTHTWEEN_CORE_METRICS_SENSOR_FLOOR_H_

#include <cstdint>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/metrics/regions.h"
#include "core/metrics/scores.h"

namespace depthtween {

// Difference of consecutive measured depth maps where nothing moves, as far as colour tells: the mean of 5x5 pixels
// changes by less than 3 grey levels everywhere within 4 px.
// It holds the noise of two maps: where noise is independent, an exact estimate would be scored at 1/sqrt(2) of it.
// Colour cannot tell a still camera from one that moves along untextured surfaces: trust the floor only if most pixels
// stand still.
class SensorFloor {
 public:
  // Depth beyond `far_m` is not compared.
  explicit SensorFloor(float far_m = kFarthestTruthM) : far_m_(far_m) {}
  // Depth maps in time order, each with the colour frame of its time. Metres, 0 = unknown.
  // InvalidArgument if sizes differ.
  absl::Status Add(ImageView<const Rgb8> color, ImageView<const float> depth_m);
  // The map added next does not follow the one before: they are not compared.
  void Restart();
  DepthScore Score() const { return differences_.Score(); }
  // Share of pixels known in both maps that nothing moves at, [0,1].
  double StillShare() const;

 private:
  const float far_m_;
  DepthErrors differences_;
  int64_t still_pixels_ = 0, known_pixels_ = 0;
  Image<float> previous_grey_;
  Image<float> previous_depth_m_;
};

// What is left of an error against measured truth when the truth's own noise is taken away: sqrt(rmse^2 - floor^2 / 2),
// 0 where the noise is all of it. Right as far as the noise where things move is that where nothing does.
double LessTruthNoise(double rmse_mm, double floor_rmse_mm);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_METRICS_SENSOR_FLOOR_H_
