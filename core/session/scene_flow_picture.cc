#include "core/session/scene_flow_picture.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <functional>

namespace depthtween {
namespace {

constexpr Rgb8 kUnknownMotion = {48, 48, 48};
constexpr int kBetweenPictures = 4;  // pixels between pictures

uint8_t Level(float share) { return static_cast<uint8_t>(std::lround(255.0F * std::clamp(share, 0.0F, 1.0F))); }

Image<Rgb8> Colorize(ImageView<const uint8_t> valid, const std::function<Rgb8(int, int)>& color) {
  Image<Rgb8> out(valid.width(), valid.height(), kUnknownMotion);
  for (int y = 0; y < valid.height(); ++y)
    for (int x = 0; x < valid.width(); ++x)
      if (valid(x, y) != 0) out(x, y) = color(x, y);
  return out;
}

float Norm(const Float3& v) { return std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z); }

// `hue` in turns; saturation in [0,1]; full value.
Rgb8 FromHue(float hue, float saturation) {
  const auto channel = [&](float offset) {
    const float turn = hue + offset - std::floor(hue + offset);
    const float ramp = std::clamp(std::abs(6.0F * turn - 3.0F) - 1.0F, 0.0F, 1.0F);
    return Level(1.0F - saturation * (1.0F - ramp));
  };
  return {channel(0.0F), channel(2.0F / 3), channel(1.0F / 3)};
}

}  // namespace

Image<Rgb8> ColorizeFlow(const MotionField& motion, float full_px) {
  return Colorize(motion.valid, [&](int x, int y) {
    const Flow2 flow = motion.flow_px(x, y);
    const float turns = std::atan2(flow.v, flow.u) / (2.0F * static_cast<float>(M_PI));
    return FromHue(turns, std::min(std::hypot(flow.u, flow.v) / full_px, 1.0F));
  });
}

Image<Rgb8> ColorizeDepthChange(const MotionField& motion, float full_m) {
  return Colorize(motion.valid, [&](int x, int y) {
    const float share = std::clamp(motion.motion_m(x, y).z / full_m, -1.0F, 1.0F), rest = 1.0F - std::abs(share);
    return share < 0 ? Rgb8{255, Level(rest), Level(rest)} : Rgb8{Level(rest), Level(rest), 255};
  });
}

Image<Rgb8> ColorizeMotionError(const MotionField& estimate, const MotionField& truth, float full_m) {
  return Colorize(truth.valid, [&](int x, int y) {
    if (estimate.valid(x, y) == 0) return kUnknownMotion;
    const Float3 a = estimate.motion_m(x, y), b = truth.motion_m(x, y);
    const float share = Norm({a.x - b.x, a.y - b.y, a.z - b.z}) / full_m;
    return Rgb8{Level(2.0F * share), Level(2.0F * share - 0.7F), Level(3.0F * share - 2.0F)};
  });
}

MotionRange RangeOf(const MotionField& motion) {
  std::vector<float> pixels, metres;
  for (int y = 0; y < motion.valid.height(); y += 2)
    for (int x = 0; x < motion.valid.width(); x += 2) {
      if (motion.valid(x, y) == 0) continue;
      pixels.push_back(std::hypot(motion.flow_px(x, y).u, motion.flow_px(x, y).v));
      metres.push_back(std::abs(motion.motion_m(x, y).z));
    }
  MotionRange range;
  if (pixels.empty()) return range;
  const auto percentile = [](std::vector<float>& values) {
    const auto at = values.begin() + static_cast<ptrdiff_t>(0.95 * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
  };
  range.full_px = std::max(range.full_px, percentile(pixels));
  range.full_m = std::max(range.full_m, percentile(metres));
  return range;
}

Image<Rgb8> Tile(std::span<const std::vector<Image<Rgb8>>> rows) {
  assert(!rows.empty() && !rows[0].empty());
  const int width = rows[0][0].width(), height = rows[0][0].height();
  const int columns = static_cast<int>(rows[0].size()), lines = static_cast<int>(rows.size());
  Image<Rgb8> out(columns * (width + kBetweenPictures) - kBetweenPictures,
                  lines * (height + kBetweenPictures) - kBetweenPictures, {255, 255, 255});
  for (int row = 0; row < lines; ++row)
    for (int column = 0; column < columns; ++column)
      for (int y = 0; y < height; ++y)
        std::copy_n(rows[row][column].row(y), width,
                    out.row(row * (height + kBetweenPictures) + y) + column * (width + kBetweenPictures));
  return out;
}

}  // namespace depthtween
