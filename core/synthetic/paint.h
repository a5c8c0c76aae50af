// Procedural surface colour, fixed to the material: what optical flow can hold on to.
//
// A paint is a pattern in surface coordinates times band-limited noise in material coordinates. Everything finer than a
// pixel's footprint fades out analytically, so that one sample a pixel is enough inside a surface.
// Threads: all functions are pure.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_PAINT_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_PAINT_H_

#include <cstdint>

#include <Eigen/Core>

#include "core/base/image.h"
#include "core/geometry/camera.h"

namespace depthtween {

// Linear light, not sRGB; 1 = a white surface.
using LinearRgb = Eigen::Array3f;

// From 0xRRGGBB as designers write it.
LinearRgb FromSrgb(uint32_t hex);
// To the nearest 8-bit code; what is brighter than white is white.
Rgb8 ToSrgb(const LinearRgb& color);

enum class Pattern {
  kPlain,    // noise alone
  kPlanks,   // boards along u, grain along them
  kBricks,   // courses of bricks, second colour = mortar
  kTiles,    // square tiles, second colour = joints
  kChecks,   // two-colour chessboard
  kTartan,   // crossing bands
  kStripes,  // bands across v
  kMosaic,   // squares of many hues in two sizes: rich texture
  kPatches,  // twelve round patches on a ball
};

struct Paint {
  Pattern pattern = Pattern::kPlain;
  LinearRgb color = {0.5F, 0.5F, 0.5F};
  LinearRgb second_color = {0.1F, 0.1F, 0.1F};
  float pattern_size_m = 0.2F;
  float grain = 0.3F;          // strength of the noise: 0 = none (no texture to track), 1 = strong
  float grain_size_m = 0.12F;  // its largest feature; five octaves down from there
  uint64_t seed = 0;
};

// Albedo at a material point. `surface` are the shape's pattern coordinates; `footprint_m` is the width of a pixel
// there.
LinearRgb Albedo(const Paint& paint, const Vec3& material, const Vec2& surface, double footprint_m);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_PAINT_H_
