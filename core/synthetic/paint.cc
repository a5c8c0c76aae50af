#include "core/synthetic/paint.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/synthetic/random.h"

namespace depthtween {
namespace {

constexpr int kOctaves = 5;
// Each octave has half the feature size and this much of the amplitude of the one before: about the fall of natural
// images.
constexpr float kGain = 0.68F;

float LatticeValue(int x, int y, int z, uint32_t seed) {
  uint32_t h = seed + static_cast<uint32_t>(x) * 0x8DA6B343U + static_cast<uint32_t>(y) * 0xD8163841U +
               static_cast<uint32_t>(z) * 0xCB1AB31FU;
  h ^= h >> 15;
  h *= 0x2C1B3C6DU;
  h ^= h >> 12;
  h *= 0x297A2D39U;
  h ^= h >> 15;
  return static_cast<float>(h >> 8) * (2.0F / 16777216.0F) - 1.0F;
}

// Value noise in [-1, 1] with features of unit size, twice differentiable.
float Noise(float x, float y, float z, uint32_t seed) {
  const float fx = std::floor(x), fy = std::floor(y), fz = std::floor(z);
  const int ix = static_cast<int>(fx), iy = static_cast<int>(fy), iz = static_cast<int>(fz);
  const auto fade = [](float t) { return t * t * t * (t * (t * 6 - 15) + 10); };
  const float ax = fade(x - fx), ay = fade(y - fy), az = fade(z - fz);
  const auto along_x = [&](int dy, int dz) {
    const float a = LatticeValue(ix, iy + dy, iz + dz, seed), b = LatticeValue(ix + 1, iy + dy, iz + dz, seed);
    return a + ax * (b - a);
  };
  const float near_z = along_x(0, 0) + ay * (along_x(1, 0) - along_x(0, 0));
  const float far_z = along_x(0, 1) + ay * (along_x(1, 1) - along_x(0, 1));
  return near_z + az * (far_z - near_z);
}

// How much of a feature of this size survives averaging over a pixel: all above four footprints, nothing below two.
float Survival(float size_m, float footprint_m) { return std::clamp(size_m / (2 * footprint_m) - 1.0F, 0.0F, 1.0F); }

float FractalNoise(const Eigen::Array3f& point, float size_m, float footprint_m, uint32_t seed) {
  float sum = 0.0F, amplitude = 0.75F;
  for (int octave = 0; octave < kOctaves; ++octave) {
    const float survival = Survival(size_m, footprint_m);
    if (survival <= 0) break;
    const float scale = 1.0F / size_m;
    sum += amplitude * survival *
           Noise(point.x() * scale, point.y() * scale, point.z() * scale, seed + static_cast<uint32_t>(octave) * 7919U);
    amplitude *= kGain;
    size_m *= 0.5F;
  }
  return sum;
}

// A unit ramp of one footprint around x = 0: the area of a pixel on the positive side of an edge.
float Coverage(float x, float footprint_m) { return std::clamp(x / footprint_m + 0.5F, 0.0F, 1.0F); }

// Share of a pixel inside bands of width `band` that repeat with `period`, the first centred on 0.
float Bands(float x, float period, float band, float footprint_m) {
  if (footprint_m > period) return band / period;
  const float distance = std::abs(x - period * std::round(x / period));
  return Coverage(0.5F * band - distance, footprint_m);
}

float CellValue(int i, int j, uint64_t seed) { return static_cast<float>(UniformFrom(RandomBits(seed, i, j))); }

// Rectangular cells of one pattern with joints between them, rows shifted against one another.
LinearRgb Courses(const Paint& p, const Vec2& surface, float length, float height, float joint, float shift, float tint,
                  float footprint) {
  const float v = static_cast<float>(surface.y()) / height;
  const int row = static_cast<int>(std::floor(v));
  const float u = static_cast<float>(surface.x()) / length + shift * static_cast<float>(row);
  const int cell = static_cast<int>(std::floor(u));
  const float to_joint_u = std::min(u - std::floor(u), std::ceil(u) - u) * length;
  const float to_joint_v = std::min(v - std::floor(v), std::ceil(v) - v) * height;
  const float inside = Coverage(std::min(to_joint_u, to_joint_v) - 0.5F * joint, std::max(footprint, 0.25F * joint));
  const float survival = Survival(height * 2, footprint);
  const LinearRgb cell_color = p.color * (1.0F + survival * tint * (CellValue(cell, row, p.seed) - 0.5F));
  return inside * cell_color + (1 - inside) * p.second_color;
}

LinearRgb Hue(float h) {
  // Muted hues, all about equally bright, so that neighbours differ in colour as well as in grey.
  const auto wave = [](float t) { return 0.5F + 0.5F * std::cos(6.2831853F * t); };
  return 0.18F + 0.55F * LinearRgb(wave(h), wave(h - 0.33F), wave(h - 0.67F));
}

LinearRgb Mosaic(const Paint& p, const Vec2& surface, float footprint) {
  LinearRgb sum = LinearRgb::Zero();
  float size = p.pattern_size_m, weight = 0.6F;
  for (int layer = 0; layer < 2; ++layer) {
    // Bilinear between cells over one footprint: the exact box filter of the squares.
    const float survival = Survival(size, footprint);
    const float u = static_cast<float>(surface.x()) / size, v = static_cast<float>(surface.y()) / size;
    const float i = std::floor(u + 0.5F), j = std::floor(v + 0.5F);
    const float a = Coverage((u - i) * size, footprint), b = Coverage((v - j) * size, footprint);
    const auto cell = [&](float di, float dj) {
      const float value =
          CellValue(static_cast<int>(i + di), static_cast<int>(j + dj), p.seed + static_cast<uint64_t>(layer));
      const float bright = CellValue(static_cast<int>(i + di), static_cast<int>(j + dj), p.seed + 17U);
      return LinearRgb((0.25F + bright) * Hue(value));
    };
    const LinearRgb upper = (1 - a) * cell(-1, -1) + a * cell(0, -1);
    const LinearRgb lower = (1 - a) * cell(-1, 0) + a * cell(0, 0);
    sum += weight * (survival * ((1 - b) * upper + b * lower) + (1 - survival) * 0.4F);
    weight = 0.4F;
    size *= 0.3F;
  }
  return p.color * sum;
}

// The patches of a football sit at the corners of an icosahedron.
float PatchCoverage(const Vec3& material, float cosine, float footprint_m) {
  constexpr float kA = 0.525731112F, kB = 0.850650808F;
  const double radius = material.norm();
  const Eigen::Array3f n = (material / radius).cast<float>().array().abs();
  // By symmetry the nearest of the twelve corners is one of these three in the positive octant.
  const float best = std::max({kA * n.x() + kB * n.z(), kA * n.y() + kB * n.x(), kA * n.z() + kB * n.y()});
  return Coverage((std::acos(cosine) - std::acos(std::min(best, 1.0F))) * static_cast<float>(radius), footprint_m);
}

}  // namespace

LinearRgb FromSrgb(uint32_t hex) {
  const auto linear = [](uint32_t byte) {
    const float c = static_cast<float>(byte & 0xFFU) / 255.0F;
    return c <= 0.04045F ? c / 12.92F : std::pow((c + 0.055F) / 1.055F, 2.4F);
  };
  return {linear(hex >> 16), linear(hex >> 8), linear(hex)};
}

Rgb8 ToSrgb(const LinearRgb& color) {
  const auto encode = [](float linear) {
    const float c = std::clamp(linear, 0.0F, 1.0F);
    const float encoded = c <= 0.0031308F ? 12.92F * c : 1.055F * std::pow(c, 1.0F / 2.4F) - 0.055F;
    return static_cast<uint8_t>(std::lround(255.0F * encoded));
  };
  return {encode(color[0]), encode(color[1]), encode(color[2])};
}

LinearRgb Albedo(const Paint& p, const Vec3& material, const Vec2& surface, double footprint_m) {
  const float footprint = std::max(static_cast<float>(footprint_m), 1e-5F);
  const float size = p.pattern_size_m;
  const float u = static_cast<float>(surface.x()), v = static_cast<float>(surface.y());
  Eigen::Array3f grain_point = material.cast<float>().array();
  LinearRgb color = p.color;
  switch (p.pattern) {
    case Pattern::kPlain:
      break;
    case Pattern::kPlanks:
      color = Courses(p, surface, 7.3F * size, size, 0.004F, 0.37F, 0.45F, footprint);
      // Wood grain runs along the boards and changes from one to the next.
      grain_point = {u * 0.12F, v, 3.1F * std::floor(v / size)};
      break;
    case Pattern::kBricks:
      color = Courses(p, surface, 3.0F * size, size, 0.15F * size, 0.5F, 0.6F, footprint);
      break;
    case Pattern::kTiles:
      color = Courses(p, surface, size, size, 0.04F * size, 0.0F, 0.25F, footprint);
      break;
    case Pattern::kChecks: {
      const float a = Bands(u - 0.5F * size, 2 * size, size, footprint),
                  b = Bands(v - 0.5F * size, 2 * size, size, footprint);
      const float share = a * b + (1 - a) * (1 - b);
      color = share * p.color + (1 - share) * p.second_color;
      break;
    }
    case Pattern::kTartan: {
      const float wide = 0.5F * (Bands(u, size, 0.45F * size, footprint) + Bands(v, size, 0.45F * size, footprint));
      const float thin = std::max(Bands(u + 0.5F * size, size, 0.05F * size, footprint),
                                  Bands(v + 0.5F * size, size, 0.05F * size, footprint));
      color = (1 - wide) * p.color + wide * p.second_color;
      color = (1 - 0.7F * thin) * color + 0.7F * thin * LinearRgb(0.8F, 0.75F, 0.5F);
      break;
    }
    case Pattern::kStripes: {
      const float share = Bands(v, size, 0.5F * size, footprint);
      color = (1 - share) * p.color + share * p.second_color;
      break;
    }
    case Pattern::kMosaic:
      color = Mosaic(p, surface, footprint);
      break;
    case Pattern::kPatches: {
      const float share = PatchCoverage(material, 0.92F, footprint);
      color = (1 - share) * p.color + share * p.second_color;
      break;
    }
  }
  if (p.grain > 0) {
    const uint32_t seed = static_cast<uint32_t>(MixBits(p.seed));
    const float noise = FractalNoise(grain_point, p.grain_size_m, footprint, seed);
    color *= std::exp(1.1F * p.grain * noise);
    // A slow drift between warm and cold keeps large surfaces from being one hue.
    const float drift = 0.25F * p.grain *
                        Noise(grain_point.x() / (2.7F * p.grain_size_m), grain_point.y() / (2.7F * p.grain_size_m),
                              grain_point.z() / (2.7F * p.grain_size_m), seed + 101U);
    color *= LinearRgb(1 + drift, 1.0F, 1 - drift);
  }
  return color.max(0.0F).min(0.95F);
}

}  // namespace depthtween
