#include "core/upsample/match.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/base/lanes.h"

namespace depthtween {
namespace {

constexpr float kGradientWeight = 0.5F;
// Support falls to a half where the colours differ by this much (sum over three channels).
constexpr float kSupportColor = 30.0F;

}  // namespace

MatchImage::MatchImage(ImageView<const Rgb8> color) : width_(color.width()), height_(color.height()) {
  for (auto& plane : planes_) plane = Image<float>(width_ + 2 * kBorder, height_ + 2 * kBorder);
  const auto luma = [&](int x, int y) {
    const Rgb8& c = color.Clamped(x, y);
    return 0.299F * c.r + 0.587F * c.g + 0.114F * c.b;
  };
  for (int y = -kBorder; y < height_ + kBorder; ++y) {
    float* out[kPlanes];
    for (int p = 0; p < kPlanes; ++p) out[p] = planes_[p].row(y + kBorder) + kBorder;
    for (int x = -kBorder; x < width_ + kBorder; ++x) {
      const Rgb8& c = color.Clamped(x, y);
      out[0][x] = c.r;
      out[1][x] = c.g;
      out[2][x] = c.b;
      out[3][x] = 0.5F * (luma(x + 1, y) - luma(x - 1, y));
      out[4][x] = 0.5F * (luma(x, y + 1) - luma(x, y - 1));
    }
  }
}

MatchPatch::MatchPatch(const MatchImage& target, int x, int y) {
  const float r = target.row(0, y)[x], g = target.row(1, y)[x], b = target.row(2, y)[x];
  constexpr Lanes kInWindow = {1, 1, 1, 1, 1, 0, 0, 0};
  static_assert(kRows == 5, "kInWindow has one lane per column of the window");
  Lanes total = {};
  for (int i = 0; i < kRows; ++i) {
    const int row = y + i - kRadius;
    for (int p = 0; p < MatchImage::kPlanes; ++p) {
      const Lanes v = LoadLanes(target.row(p, row) + x - kRadius);
      std::memcpy(value_[p][i], &v, sizeof(v));
    }
    const Lanes difference = AbsLanes(LoadLanes(value_[0][i]) - r) + AbsLanes(LoadLanes(value_[1][i]) - g) +
                             AbsLanes(LoadLanes(value_[2][i]) - b);
    const Lanes ratio = difference * (1.0F / kSupportColor);
    const Lanes weight = kInWindow / (1.0F + ratio * ratio);
    std::memcpy(weight_[i], &weight, sizeof(weight));
    total += weight;
  }
  float sum = 0;
  for (int i = 0; i < kLanes; ++i) sum += total[i];
  for (auto& row : weight_)
    for (float& w : row) w /= sum;
}

float MatchPatch::CostAt(const MatchImage& key, float x, float y, float limit) const {
  // The window may hang over the edge by the border, the centre by a pixel.
  if (!(x > -1.0F && y > -1.0F && x < static_cast<float>(key.width()) && y < static_cast<float>(key.height())))
    return kTruncation;
  const float floor_x = std::floor(x), floor_y = std::floor(y);
  const int x0 = static_cast<int>(floor_x) - kRadius, y0 = static_cast<int>(floor_y) - kRadius;
  const float ax = x - floor_x, ay = y - floor_y;
  const float w00 = (1 - ax) * (1 - ay), w10 = ax * (1 - ay), w01 = (1 - ax) * ay, w11 = ax * ay;
  float cost = 0;
  // The centre row first: it weighs most, and most proposals are refused by it.
  constexpr int kOrder[kRows] = {2, 1, 3, 0, 4};
  for (const int i : kOrder) {
    Lanes color = {}, gradient = {};
    for (int p = 0; p < MatchImage::kPlanes; ++p) {
      const float* top = key.row(p, y0 + i) + x0;
      const float* bottom = key.row(p, y0 + i + 1) + x0;
      const Lanes there =
          w00 * LoadLanes(top) + w10 * LoadLanes(top + 1) + w01 * LoadLanes(bottom) + w11 * LoadLanes(bottom + 1);
      const Lanes difference = AbsLanes(there - LoadLanes(value_[p][i]));
      (p < 3 ? color : gradient) += difference;
    }
    const Lanes difference = color * (1.0F / 3.0F) + gradient * kGradientWeight;
    const Lanes truncated = MinLanes(difference, AllLanes(kTruncation));
    const Lanes weighted = truncated * LoadLanes(weight_[i]);
    cost += ((weighted[0] + weighted[1]) + (weighted[2] + weighted[3])) + weighted[4];
    if (cost > limit) break;
  }
  return cost;
}

}  // namespace depthtween
