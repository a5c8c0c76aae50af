#include "core/render/linear_light.h"

#include <cmath>

namespace depthtween {

LinearLight::LinearLight() {
  for (int code = 0; code < 256; ++code) {
    const double c = code / 255.0;
    decoded_[code] = static_cast<float>(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
  }
  for (int step = 0; step <= kSteps; ++step) {
    const double c = static_cast<double>(step) / kSteps;
    encoded_[step] =
        static_cast<uint8_t>(std::lround(255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1 / 2.4) - 0.055)));
  }
}

const LinearLight& LinearLight::Tables() {
  static const LinearLight tables;
  return tables;
}

}  // namespace depthtween
