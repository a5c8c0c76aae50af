// sRGB against the standard's formula.
#include "core/render/linear_light.h"

#include <cmath>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

TEST(LinearLight, EncodesWhatItDecoded) {
  const LinearLight& tables = LinearLight::Tables();
  for (int code = 0; code < 256; ++code) {
    const auto byte = static_cast<uint8_t>(code);
    EXPECT_EQ(tables.Encode(tables.Decode(byte)), byte);
  }
  EXPECT_EQ(tables.Encode(-0.5F), 0);
  EXPECT_EQ(tables.Encode(7.0F), 255);
}

// The standard's formula, evaluated directly, says which code is nearest.
TEST(LinearLight, EncodesToTheNearestCode) {
  const LinearLight& tables = LinearLight::Tables();
  for (int i = 0; i <= 100000; ++i) {
    const double linear = i / 100000.0;
    const double exact = 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055);
    EXPECT_LE(std::abs(tables.Encode(static_cast<float>(linear)) - exact), 0.6) << linear;
  }
}

// Mid grey of a camera's chart: 18 % of white.
TEST(LinearLight, KnowsMiddleGrey) { EXPECT_EQ(LinearLight::Tables().Encode(0.18F), 118); }

}  // namespace
}  // namespace depthtween
