// Whether a stereo clip can be watched with ease: how far the eyes must turn against their focus, and what the frame
// cuts in front of the screen.
//
// Sign:     as core/render/stereo.h: crossed (in front of the screen) is positive.
// Source:   one degree either side of the screen: Lambooij et al., Visual Discomfort and Visual Fatigue of Stereoscopic
//           Displays: A Review, J. Imaging Sci. Technol. 2009.
#ifndef DEPTHTWEEN_CORE_RENDER_COMFORT_H_
#define DEPTHTWEEN_CORE_RENDER_COMFORT_H_

#include <cstdint>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/render/stereo.h"

namespace depthtween {

struct Screen {
  double width_m = 1.0, distance_m = 3.0;  // > 0

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

inline constexpr double kEyeDistanceM = 0.063;  // of an average adult
inline constexpr double kComfortableDeg = 1.0;

// The angle by which the eyes turn in (positive) from the screen, for a disparity in shares of the image's width.
double VergenceDeg(double disparity_share, const Screen& screen);

struct ComfortReport {
  Screen screen;
  int64_t frames = 0;
  // 99th and 1st percentile of disparity over all pixels: the nearest and the farthest that matters.
  double near_percent = 0.0, far_percent = 0.0;  // of the image's width
  double near_deg = 0.0, far_deg = 0.0;          // > 0 crossed, < 0 uncrossed
  bool eyes_diverge = false;                     // the farthest would need eyes that point outwards
  int64_t window_violations = 0;                 // frames that cut something in front of their window at a side
  // What to multiply the baseline by so that both percentiles stay within a degree and no eye turns outwards; at
  // most 2.
  double recommended_strength = 1.0;

  nlohmann::json ToJson() const;
};

// Of frames, in any order and from any process: parts are merged.
class ComfortStatistics {
 public:
  // Unknown depth does not count. All frames under the same geometry.
  void AddFrame(ImageView<const float> depth_m, const StereoGeometry& geometry);
  void Merge(const ComfortStatistics& other);

  nlohmann::json ToJson() const;
  // InvalidArgument if it is not what ToJson makes.
  static absl::StatusOr<ComfortStatistics> FromJson(const nlohmann::json& json);

  // `screen` must validate.
  ComfortReport Report(const Screen& screen) const;

 private:
  double Percentile(double share) const;  // share of width

  static constexpr int kHalfBins = 2500;  // each 0.02 % of the width; farther out counts in the last
  static constexpr double kBinShare = 0.0002;
  std::vector<int64_t> pixels_ = std::vector<int64_t>(2 * kHalfBins + 1);
  int64_t frames_ = 0, window_violations_ = 0;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_COMFORT_H_
