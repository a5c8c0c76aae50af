// A recording whose truth is simple and whose frames cost nothing: painted discs that swing before a painted wall.
#ifndef DEPTHTWEEN_TESTS_CORE_CAPTURE_MOVING_DISCS_H_
#define DEPTHTWEEN_TESTS_CORE_CAPTURE_MOVING_DISCS_H_

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include "core/sequence/sequence.h"

namespace depthtween {

struct DiscsOptions {
  double seconds = 3.0;
  double color_fps = 240.0, depth_fps = 30.0;
  double offset_ms = 0.0, drift_ppm = 0.0;  // of the depth clock: shifts stamps, not what frames show
  double row_time_us = 0.0;                 // each row of colour is exposed this much later than the row above
  double speed = 1.0;                       // 0: nothing moves
};

class MovingDiscs : public FrameSource {
 public:
  static constexpr int kWidth = 128, kHeight = 96, kDiscs = 4;

  explicit MovingDiscs(const DiscsOptions& options) : options_(options) {
    sequence_.camera = {.width = kWidth, .height = kHeight, .fx = 100, .fy = 100, .cx = 63.5, .cy = 47.5};
    sequence_.depth_scale = 5000;
    for (int i = 0; i <= options.seconds * options.color_fps; ++i)
      sequence_.color.push_back({std::llround(1e9 * i / options.color_fps), "c" + std::to_string(i)});
    for (int k = 0; k <= options.seconds * options.depth_fps; ++k)
      sequence_.depth.push_back({std::llround(1e6 * options.offset_ms + (1e9 + 1e3 * options.drift_ppm) * DepthTime(k)),
                                 "d" + std::to_string(k)});
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) wall_(x, y) = static_cast<float>(Paint(kDiscs, x, y));
  }
  const Sequence& sequence() const override { return sequence_; }

  absl::StatusOr<Image<Rgb8>> Color(int index) const override {
    Image<Rgb8> color(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      // The middle row is exposed when the stamp says.
      const double time = index / options_.color_fps + 1e-6 * options_.row_time_us * (y - 0.5 * (kHeight - 1));
      const Discs discs = At(time);
      for (int x = 0; x < kWidth; ++x) {
        double level = wall_(x, y);
        for (int d = kDiscs - 1; d >= 0; --d) {
          const double dx = x - discs.x[d], dy = y - discs.y[d], reach = discs.radius[d] + 1;
          if (dx * dx + dy * dy > reach * reach) continue;
          // The share of the pixel that the disc covers.
          const double share = std::clamp(discs.radius[d] - std::hypot(dx, dy) + 0.5, 0.0, 1.0);
          level += share * (Paint(d, dx, dy) - level);
        }
        const double noise = static_cast<double>(Hash(index, y * kWidth + x) % 1000) / 250.0 - 2;
        const auto value = static_cast<uint8_t>(std::clamp(level + noise, 0.0, 255.0));
        color(x, y) = {value, static_cast<uint8_t>(value / 2 + 60), static_cast<uint8_t>(255 - value)};
      }
    }
    return color;
  }
  absl::StatusOr<Image<float>> Depth(int index) const override {
    const Discs discs = At(DepthTime(index));
    Image<float> depth(kWidth, kHeight, 3.0F);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        for (int d = kDiscs - 1; d >= 0; --d)
          if (std::hypot(x - discs.x[d], y - discs.y[d]) < discs.radius[d])
            depth(x, y) = 1.0F + 0.3F * static_cast<float>(d);
    return depth;
  }
  // When a depth frame was exposed, seconds on the colour clock.
  double DepthTime(int index) const { return index / options_.depth_fps; }

 private:
  struct Discs {
    double x[kDiscs], y[kDiscs], radius[kDiscs];
  };
  Discs At(double time) const {
    Discs discs;
    for (int d = 0; d < kDiscs; ++d) {
      const double phase = 1.7 * d, t = options_.speed * time;
      discs.x[d] = 64 + 40 * std::sin((3.1 + 0.9 * d) * t + phase);
      discs.y[d] = 48 + 26 * std::sin((4.3 - 0.7 * d) * t + 2 * phase);
      discs.radius[d] = 9 + 3 * d;
    }
    return discs;
  }
  static uint32_t Hash(uint32_t a, uint32_t b) {
    uint32_t h = a * 0x9E3779B1U ^ (b + 0x7F4A7C15U) * 0x85EBCA77U;
    h = (h ^ (h >> 15)) * 0x2C1B3C6DU;
    return h ^ (h >> 13);
  }
  // Waves of several lengths and directions, another mixture for each surface.
  static double Paint(int surface, double x, double y) {
    double level = 70.0 + 28.0 * surface;
    for (int wave = 0; wave < 4; ++wave) {
      const double angle = 0.9 * surface + 1.9 * wave, length = 4.0 + 2.7 * wave;
      level += 11 * std::sin(6.2832 / length * (x * std::cos(angle) + y * std::sin(angle)) + surface + wave);
    }
    return level;
  }

  const DiscsOptions options_;
  Sequence sequence_;
  Image<float> wall_ = Image<float>(kWidth, kHeight);
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_CAPTURE_MOVING_DISCS_H_
