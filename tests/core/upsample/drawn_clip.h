// What tests share that draw their clips by a formula, so that truth is known exactly: size, texture, comparison.
#ifndef DEPTHTWEEN_TESTS_CORE_UPSAMPLE_DRAWN_CLIP_H_
#define DEPTHTWEEN_TESTS_CORE_UPSAMPLE_DRAWN_CLIP_H_

#include <cmath>
#include <cstring>

#include "core/upsample/upsampler.h"

namespace depthtween {

inline constexpr int kWidth = 96, kHeight = 72;

// A texture without repetition within a frame; u and v in pixels.
inline Rgb8 Texture(double u, double v) {
  const double a = 128 + 55 * std::sin(0.45 * u + 0.2 * v) + 45 * std::sin(0.13 * u - 0.37 * v);
  const double b = 128 + 70 * std::sin(0.29 * u - 0.11 * v + 1);
  return {static_cast<uint8_t>(a), static_cast<uint8_t>(0.5 * a + 0.5 * b), static_cast<uint8_t>(b)};
}

// The share of pixels whose depth is at most `tolerance_m` from the truth.
inline double ShareWithin(const Image<float>& depth_m, const Image<float>& truth_m, float tolerance_m) {
  int good = 0;
  for (size_t i = 0; i < depth_m.pixel_count(); ++i)
    good += std::abs(depth_m.data()[i] - truth_m.data()[i]) <= tolerance_m;
  return static_cast<double>(good) / static_cast<double>(depth_m.pixel_count());
}

inline bool SameBits(const DepthResult& a, const DepthResult& b) {
  const size_t n = a.depth_m.pixel_count();
  return a.color_index == b.color_index && std::memcmp(a.depth_m.data(), b.depth_m.data(), n * sizeof(float)) == 0 &&
         std::memcmp(a.sigma_m.data(), b.sigma_m.data(), n * sizeof(float)) == 0 &&
         std::memcmp(a.provenance.data(), b.provenance.data(), n) == 0;
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_UPSAMPLE_DRAWN_CLIP_H_
