// Between 8-bit sRGB, as pictures are stored, and linear light, in which a lens adds.
//
// Source: IEC 61966-2-1.  Threads: everything here is immutable.
#ifndef DEPTHTWEEN_CORE_RENDER_LINEAR_LIGHT_H_
#define DEPTHTWEEN_CORE_RENDER_LINEAR_LIGHT_H_

#include <algorithm>
#include <array>
#include <cstdint>

#include "core/base/image.h"

namespace depthtween {

// Red, green, blue and weight in one register; light is multiplied by its weight.
using Light = float __attribute__((vector_size(16)));

class LinearLight {
 public:
  static const LinearLight& Tables();

  // 1 = white. Decode and then Encode is the identity for all 256 codes.
  float Decode(uint8_t code) const { return decoded_[code]; }
  // The nearest code, to within a tenth of a code; clamped to black and white.
  uint8_t Encode(float linear) const {
    return encoded_[static_cast<int>(std::clamp(linear, 0.0F, 1.0F) * kSteps + 0.5F)];
  }

  Light Decode(Rgb8 pixel) const { return Light{Decode(pixel.r), Decode(pixel.g), Decode(pixel.b), 1.0F}; }
  // `light` of weight 1.
  Rgb8 Encode(Light light) const { return {Encode(light[0]), Encode(light[1]), Encode(light[2])}; }

 private:
  LinearLight();

  static constexpr int kSteps = 1 << 14;  // five to the darkest code
  std::array<float, 256> decoded_;
  std::array<uint8_t, kSteps + 1> encoded_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_LINEAR_LIGHT_H_
