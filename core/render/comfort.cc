#include "core/render/comfort.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr double kMaxStrength = 2.0;
// A frame violates its window when more than this share of a side's rows stand at least a pixel before it.
constexpr double kViolatingRows = 0.02;
constexpr double kViolatingPx = 1.0;

// Half the angle between the eyes' axes when they meet on the screen.
double HalfAngle(const Screen& screen) { return std::atan(kEyeDistanceM / (2 * screen.distance_m)); }

// The disparity, in shares of the width, at which the eyes turn in by `deg` from the screen; never farther out than
// parallel.
double ShareAt(double deg, const Screen& screen) {
  const double half = std::max(0.0, HalfAngle(screen) + 0.5 * deg * kRadPerDeg);
  return (2 * screen.distance_m * std::tan(half) - kEyeDistanceM) / screen.width_m;
}

}  // namespace

absl::Status Screen::Validate() const {
  if (!(width_m > 0 && std::isfinite(width_m)))
    return absl::InvalidArgumentError(absl::StrFormat("screen_width_m = %g, must be > 0", width_m));
  if (!(distance_m > 0 && std::isfinite(distance_m)))
    return absl::InvalidArgumentError(absl::StrFormat("viewing_distance_m = %g, must be > 0", distance_m));
  return absl::OkStatus();
}

double VergenceDeg(double disparity_share, const Screen& screen) {
  const double apart_m = kEyeDistanceM + disparity_share * screen.width_m;
  return 2 * (std::atan(apart_m / (2 * screen.distance_m)) - HalfAngle(screen)) / kRadPerDeg;
}

void ComfortStatistics::AddFrame(ImageView<const float> depth_m, const StereoGeometry& geometry) {
  const int width = depth_m.width(), height = depth_m.height();
  const double bins_per_px = 1.0 / (width * kBinShare);
  int left = 0, right = 0;
  const auto before_window = [&](float z) {
    return z > 0 && geometry.DisparityPx(z) > geometry.window_px + kViolatingPx;
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float z = depth_m(x, y);
      if (z <= 0) continue;
      const double bin =
          std::clamp(std::round(geometry.DisparityPx(z) * bins_per_px), -1.0 * kHalfBins, 1.0 * kHalfBins);
      ++pixels_[static_cast<size_t>(bin + kHalfBins)];
    }
    left += before_window(depth_m(0, y));
    right += before_window(depth_m(width - 1, y));
  }
  ++frames_;
  window_violations_ += std::max(left, right) > kViolatingRows * height;
}

void ComfortStatistics::Merge(const ComfortStatistics& other) {
  for (size_t i = 0; i < pixels_.size(); ++i) pixels_[i] += other.pixels_[i];
  frames_ += other.frames_;
  window_violations_ += other.window_violations_;
}

nlohmann::json ComfortStatistics::ToJson() const {
  nlohmann::json bins = nlohmann::json::array();  // [bin, pixels], empty ones left out
  for (size_t i = 0; i < pixels_.size(); ++i)
    if (pixels_[i] > 0) bins.push_back({i, pixels_[i]});
  return {{"frames", frames_}, {"window_violations", window_violations_}, {"disparity", std::move(bins)}};
}

absl::StatusOr<ComfortStatistics> ComfortStatistics::FromJson(const nlohmann::json& json) {
  ComfortStatistics statistics;
  try {
    statistics.frames_ = json.at("frames").get<int64_t>();
    statistics.window_violations_ = json.at("window_violations").get<int64_t>();
    for (const nlohmann::json& bin : json.at("disparity"))
      statistics.pixels_.at(bin.at(0).get<size_t>()) = bin.at(1).get<int64_t>();
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(absl::StrFormat("comfort statistics: %s", error.what()));
  }
  return statistics;
}

double ComfortStatistics::Percentile(double share) const {
  int64_t total = 0;
  for (const int64_t pixels : pixels_) total += pixels;
  int64_t below = 0;
  for (size_t i = 0; i < pixels_.size(); ++i) {
    below += pixels_[i];
    if (below > 0 && static_cast<double>(below) >= share * static_cast<double>(total))
      return (static_cast<double>(i) - kHalfBins) * kBinShare;
  }
  return 0.0;
}

ComfortReport ComfortStatistics::Report(const Screen& screen) const {
  const double near = Percentile(0.99), far = Percentile(0.01);
  ComfortReport report;
  report.screen = screen;
  report.frames = frames_;
  report.near_percent = 100 * near, report.far_percent = 100 * far;
  report.near_deg = VergenceDeg(near, screen), report.far_deg = VergenceDeg(far, screen);
  report.eyes_diverge = kEyeDistanceM + far * screen.width_m < 0;
  report.window_violations = window_violations_;
  double strength = kMaxStrength;
  if (near > 0) strength = std::min(strength, ShareAt(kComfortableDeg, screen) / near);
  if (far < 0) strength = std::min(strength, ShareAt(-kComfortableDeg, screen) / far);
  report.recommended_strength = strength;
  return report;
}

nlohmann::json ComfortReport::ToJson() const {
  return {{"screen_width_m", screen.width_m},
          {"viewing_distance_m", screen.distance_m},
          {"frames", frames},
          {"near_percent_of_width", near_percent},
          {"far_percent_of_width", far_percent},
          {"near_deg", near_deg},
          {"far_deg", far_deg},
          {"eyes_diverge", eyes_diverge},
          {"window_violation_frames", window_violations},
          {"recommended_strength", recommended_strength}};
}

}  // namespace depthtween
