#include "core/metrics/sensor_floor.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/metrics/regions.h"

namespace depthtween {
namespace {

constexpr int kMeanRadius = 2;   // averages colour noise of about 2 levels down to under one
constexpr int kGuardRadius = 4;  // depth edges are ragged beyond the colour edge they belong to
constexpr float kStillLevels = 3.0F;

Image<float> LocalMeanGrey(ImageView<const Rgb8> color) {
  Image<float> mean(color.width(), color.height());
  for (int y = 0; y < color.height(); ++y) {
    for (int x = 0; x < color.width(); ++x) {
      int sum = 0;
      for (int dy = -kMeanRadius; dy <= kMeanRadius; ++dy)
        for (int dx = -kMeanRadius; dx <= kMeanRadius; ++dx) {
          const Rgb8 c = color.Clamped(x + dx, y + dy);
          sum += c.r + c.g + c.b;
        }
      constexpr int kSide = 2 * kMeanRadius + 1;
      mean(x, y) = static_cast<float>(sum) / (3.0F * kSide * kSide);
    }
  }
  return mean;
}

}  // namespace

absl::Status SensorFloor::Add(ImageView<const Rgb8> color, ImageView<const float> depth_m) {
  const int width = depth_m.width(), height = depth_m.height();
  const bool first = previous_depth_m_.empty();
  if (!color.SameSize(depth_m) || (!first && !depth_m.SameSize(previous_depth_m_.view())))
    return absl::InvalidArgumentError(
        absl::StrFormat("depth is %d x %d, colour %d x %d, frame before %d x %d, must be the same", width, height,
                        color.width(), color.height(), previous_depth_m_.width(), previous_depth_m_.height()));
  Image<float> grey = LocalMeanGrey(color);
  Image<float> depth_copy_m(width, height);
  for (int y = 0; y < height; ++y) std::copy_n(depth_m.row(y), width, depth_copy_m.row(y));
  if (!first) {
    Image<uint8_t> changed(width, height);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        changed(x, y) = std::abs(grey(x, y) - previous_grey_(x, y)) >= kStillLevels ? 1 : 0;
    const Image<uint8_t> moves = DilateSquare(changed, kGuardRadius);
    const auto scored = [far = far_m_](float z) { return z > 0.0F && z < far; };
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        if (!scored(depth_copy_m(x, y)) || !scored(previous_depth_m_(x, y))) continue;
        ++known_pixels_;
        if (moves(x, y) != 0) continue;
        ++still_pixels_;
        differences_.Add(depth_copy_m(x, y) - previous_depth_m_(x, y));
      }
    }
  }
  previous_grey_ = std::move(grey);
  previous_depth_m_ = std::move(depth_copy_m);
  return absl::OkStatus();
}

void SensorFloor::Restart() {
  previous_grey_ = {};
  previous_depth_m_ = {};
}

double LessTruthNoise(double rmse_mm, double floor_rmse_mm) {
  return std::sqrt(std::max(0.0, rmse_mm * rmse_mm - 0.5 * floor_rmse_mm * floor_rmse_mm));
}

double SensorFloor::StillShare() const {
  return known_pixels_ > 0 ? static_cast<double>(still_pixels_) / static_cast<double>(known_pixels_) : 0.0;
}

}  // namespace depthtween
