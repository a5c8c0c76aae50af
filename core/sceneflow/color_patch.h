// How alike two places of two pictures are.
//
// Threads: immutable; safe to use concurrently.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_COLOR_PATCH_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_COLOR_PATCH_H_

#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/image.h"

namespace depthtween {

// Red, green and blue, and one more that is always 0: four floats are computed on at once.
typedef float Color4 __attribute__((vector_size(16)));
inline Color4 Abs(Color4 v) { return v < 0 ? -v : v; }
inline float Sum(Color4 v) { return v[0] + v[1] + v[2]; }

inline Image<Color4> ToFloats(ImageView<const Rgb8> color) {
  Image<Color4> out(color.width(), color.height());
  for (int y = 0; y < color.height(); ++y)
    for (int x = 0; x < color.width(); ++x) {
      const Rgb8 c = color(x, y);
      out(x, y) = Color4{static_cast<float>(c.r), static_cast<float>(c.g), static_cast<float>(c.b), 0.0F};
    }
  return out;
}

// The colours around a pixel, those of its surface and like its own counting most; compared with another place, a
// change that all share, as of light, counts little.
class ColorPatch {
 public:
  static constexpr int kReach = 2, kSide = 2 * kReach + 1;
  static constexpr float kLikeness = 90.0F;      // sum over channels: counts half
  static constexpr float kOtherSurface = 0.1F;   // what pixels of another surface count
  static constexpr float kSharedChange = 0.25F;  // what a shared change counts
  static constexpr float kTruncation = 120.0F;   // sum over channels

  ColorPatch(ImageView<const Color4> image, ImageView<const int> labels, int x, int y) {
    float total = 0.0F;
    const Color4 centre = image(x, y);
    for (int i = 0; i < kSide * kSide; ++i) {
      const int px = std::clamp(x + i % kSide - kReach, 0, image.width() - 1);
      const int py = std::clamp(y + i / kSide - kReach, 0, image.height() - 1);
      color_[i] = image(px, py);
      const float unlike = Sum(Abs(color_[i] - centre)) / kLikeness;
      weight_[i] = (labels(px, py) == labels(x, y) ? 1.0F : kOtherSurface) / (1.0F + unlike * unlike);
      total += weight_[i];
    }
    for (float& weight : weight_) weight /= total;
  }

  // In [0,1]. Bilinear; beyond the image its edge repeats.
  float CostAt(ImageView<const Color4> image, float x, float y) const {
    const float fx = std::floor(x), fy = std::floor(y), ax = x - fx, ay = y - fy;
    const int x0 = static_cast<int>(fx) - kReach, y0 = static_cast<int>(fy) - kReach;
    std::array<int, kSide + 1> columns;
    for (int i = 0; i <= kSide; ++i) columns[i] = std::clamp(x0 + i, 0, image.width() - 1);
    std::array<Color4, kSide * kSide> change;
    Color4 shared = {};
    std::array<Color4, kSide> above;
    for (int j = 0; j <= kSide; ++j) {
      const Color4* row = image.row(std::clamp(y0 + j, 0, image.height() - 1));
      for (int i = 0; i < kSide; ++i) {
        const Color4 left = row[columns[i]];
        const Color4 here = left + ax * (row[columns[i + 1]] - left);
        if (j > 0) {
          const int tap = (j - 1) * kSide + i;
          change[tap] = above[i] + ay * (here - above[i]) - color_[tap];
          shared += weight_[tap] * change[tap];
        }
        above[i] = here;
      }
    }
    float sum = 0.0F;
    for (int i = 0; i < kSide * kSide; ++i) sum += weight_[i] * std::min(Sum(Abs(change[i] - shared)), kTruncation);
    return std::min((sum + kSharedChange * Sum(Abs(shared))) / kTruncation, 1.0F);
  }

 private:
  std::array<Color4, kSide * kSide> color_;
  std::array<float, kSide * kSide> weight_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_COLOR_PATCH_H_
