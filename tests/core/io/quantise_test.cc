// Stored depth and metres, over all 65,536 values.
#include "core/io/quantise.h"

#include <cmath>
#include <limits>

#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

// All 65536 stored values, so nothing is left to chance.
TEST(Quantise, StoredDepthSurvivesMetres) {
  Image<uint16_t> all(256, 256);
  for (int i = 0; i < 65536; ++i) all(i % 256, i / 256) = static_cast<uint16_t>(i);
  for (const double scale : {1.0, 256.0, 1000.0, 1000.0 / 3, 5000.0, 10000.0, 65535.0}) {
    EXPECT_TRUE(SamePixels(QuantiseDepth(DequantiseDepth(all, scale), scale), all)) << scale;
    // Uncertainty: 0 alone does not come back, for a known uncertainty is never none.
    Image<uint16_t> sigma = QuantiseSigma(DequantiseSigma(all, scale), scale);
    EXPECT_EQ(sigma(0, 0), kUnknownSigmaUnits);
    sigma(0, 0) = 0;
    EXPECT_TRUE(SamePixels(sigma, all)) << scale;
  }
}

// What sensors write where nothing was measured is no depth of 65.5 m; the code below it is one.
TEST(Quantise, LargestCodeOfARecordingIsUnknown) {
  Image<uint16_t> units(3, 1);
  units(0, 0) = 65535;
  units(1, 0) = 65534;
  units(2, 0) = 1500;
  const Image<float> depth_m = DequantiseRecordedDepth(units, 1000);
  EXPECT_EQ(depth_m(0, 0), 0.0F);
  EXPECT_EQ(depth_m(1, 0), 65.534F);
  EXPECT_EQ(depth_m(2, 0), 1.5F);
}

TEST(Quantise, RoundsToNearest) {
  EXPECT_EQ(DepthToUnits(1.2344F, 1000), 1234);
  EXPECT_EQ(DepthToUnits(1.2346F, 1000), 1235);
  EXPECT_EQ(DepthToUnits(0.0004F, 1000), 0);
  EXPECT_EQ(SigmaToUnits(0.0116F, 1000), 12);
}

TEST(Quantise, SaturatesAndKeepsUnknown) {
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  for (const float unknown : {0.0F, -1.0F, -inf, nan}) {
    EXPECT_EQ(DepthToUnits(unknown, 1000), kUnknownDepthUnits);
    EXPECT_EQ(SigmaToUnits(unknown, 1000), kUnknownSigmaUnits);
  }
  for (const float huge : {66.0F, 1e30F, inf}) {
    EXPECT_EQ(DepthToUnits(huge, 1000), 65535);
    EXPECT_EQ(SigmaToUnits(huge, 1000), 65534);
  }
  EXPECT_EQ(SigmaToUnits(1e-9F, 1000), 1);
}

}  // namespace
}  // namespace depthtween
