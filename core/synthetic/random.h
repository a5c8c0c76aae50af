// Random numbers as functions of their address (seed, stream, frame, pixel ...), so that a value depends neither on the
// order nor on the thread it is drawn in.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_RANDOM_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_RANDOM_H_

#include <cmath>
#include <cstdint>

namespace depthtween {

// The finaliser of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014).
inline uint64_t MixBits(uint64_t x) {
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}

template <typename... Address>
uint64_t RandomBits(uint64_t seed, Address... address) {
  ((seed = MixBits(seed ^ static_cast<uint64_t>(address))), ...);
  return MixBits(seed);
}

// Uniform in [0, 1).
inline double UniformFrom(uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

// Standard normal (Box-Muller; the two uniforms are the halves of the bits).
inline double NormalFrom(uint64_t bits) {
  const double a = (static_cast<double>(bits >> 32) + 0.5) * 0x1p-32;
  const double b = static_cast<double>(bits & 0xFFFFFFFFU) * 0x1p-32;
  return std::sqrt(-2.0 * std::log(a)) * std::cos(6.283185307179586 * b);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_RANDOM_H_
