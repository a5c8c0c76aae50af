#include "core/upsample/match.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "core/base/lanes.h"

namespace depthtween {
namespace {

constexpr float kGradientWeight = 0.5F;
// Support falls to a half where the colours differ by this much (sum over three channels).
constexpr float kSupportColor = 30.0F;

}  // namespace

MatchImage::MatchImage(ImageView<const Rgb8> color)
    : width_(color.width()),
      height_(color.height()),
      plane_stride_(width_ + 2 * kBorder),
      planes_(kPlanes * static_cast<int>(plane_stride_), height_ + 2 * kBorder) {
  // Luma of the rows above, at and below one, and of a pixel more than the border on either side.
  std::vector<float> luma[3];
  for (auto& row : luma) row.resize(width_ + 2 * kBorder + 2);
  const auto fill = [&](int y, std::vector<float>& row) {
    const Rgb8* const in = color.row(std::clamp(y, 0, height_ - 1));
    for (int x = 0; x < width_; ++x) row[x + kBorder + 1] = 0.299F * in[x].r + 0.587F * in[x].g + 0.114F * in[x].b;
    std::fill_n(row.begin(), kBorder + 1, row[kBorder + 1]);
    std::fill_n(row.end() - kBorder - 1, kBorder + 1, row[width_ + kBorder]);
  };
  fill(-kBorder - 1, luma[0]);
  fill(-kBorder, luma[1]);
  for (int y = -kBorder; y < height_ + kBorder; ++y) {
    fill(y + 1, luma[2]);
    const Rgb8* const in = color.row(std::clamp(y, 0, height_ - 1));
    float* const out = planes_.row(y + kBorder);
    for (int x = 0; x < plane_stride_; ++x) {
      const Rgb8 c = in[std::clamp(x - kBorder, 0, width_ - 1)];
      out[x] = c.r;
      out[x + plane_stride_] = c.g;
      out[x + 2 * plane_stride_] = c.b;
      out[x + 3 * plane_stride_] = 0.5F * (luma[1][x + 2] - luma[1][x]);
      out[x + 4 * plane_stride_] = 0.5F * (luma[2][x + 1] - luma[0][x + 1]);
    }
    std::swap(luma[0], luma[1]);
    std::swap(luma[1], luma[2]);
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
  const float* const corner = key.row(0, y0) + x0;
  const ptrdiff_t plane_stride = key.plane_stride(), row_stride = key.row_stride();
  float cost = 0;
  // The centre row first: it weighs most, and most proposals are refused by it.
  for (const int i : {2, 1, 3, 0, 4}) {
    const float* const row = corner + i * row_stride;
    Lanes color = {}, gradient = {};
    for (int p = 0; p < MatchImage::kPlanes; ++p) {
      const float* const top = row + p * plane_stride;
      const float* const bottom = top + row_stride;
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
