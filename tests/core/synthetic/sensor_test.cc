// The sensor's noise against the model that it states.
#include "core/synthetic/sensor.h"

#include <algorithm>
#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kWidth = 320, kHeight = 240;

// Left of `edge_x` at `left_m`, from it on at `right_m`; bright everywhere.
SurfaceTruth Step(int edge_x, float left_m, float right_m) {
  SurfaceTruth truth{Image<float>(kWidth, kHeight), Image<uint8_t>(kWidth, kHeight, 1),
                     Image<float>(kWidth, kHeight, 0.8F)};
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) truth.depth_m(x, y) = x < edge_x ? left_m : right_m;
  return truth;
}

// A plane at z is measured around z with the standard deviation that the model states: known by its definition. With
// 76800 pixels the estimate of sigma is good to 0.3 %.
TEST(MeasureDepth, NoiseGrowsWithDepthAsStated) {
  const SensorModel model{.noise_a_m = 0.0015, .noise_b_per_m = 0.0004};
  for (const float z : {1.0F, 2.0F, 4.5F}) {
    const Image<float> measured = MeasureDepth(model, Step(0, z, z), 1, 0);
    double sum = 0, square = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const double error = measured(x, y) - z;
        sum += error;
        square += error * error;
      }
    const double count = kWidth * kHeight, sigma = 0.0015 + 0.0004 * z * z;
    EXPECT_NEAR(sum / count, 0, 4 * sigma / std::sqrt(count));
    EXPECT_NEAR(std::sqrt(square / count), sigma, 0.015 * sigma);
  }
}

TEST(MeasureDepth, QuantisesAndDropsOutAsStated) {
  const SensorModel model{.random_dropout_share = 0.005, .quantum_m = 0.001};
  const Image<float> measured = MeasureDepth(model, Step(0, 2.00037F, 2.00037F), 1, 0);
  int missing = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      missing += measured(x, y) == 0;
      if (measured(x, y) > 0) {
        EXPECT_FLOAT_EQ(measured(x, y), 2.0F);
      }
    }
  EXPECT_NEAR(missing, 0.005 * kWidth * kHeight, 4 * std::sqrt(0.005 * kWidth * kHeight));
}

// Two columns lie beside a step. There, and nowhere else, the stated share of pixels mixes both sides.
TEST(MeasureDepth, PixelsFlyBesideEdgesOnly) {
  const SensorModel model{.flying_share = 0.35};
  int flying = 0, frames = 10;
  for (int frame = 0; frame < frames; ++frame) {
    const Image<float> measured = MeasureDepth(model, Step(100, 1.5F, 3.0F), 1, frame);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const float exact = x < 100 ? 1.5F : 3.0F;
        if (x < 99 || x > 100) {
          ASSERT_EQ(measured(x, y), exact);
        }
        ASSERT_GE(measured(x, y), 1.5F);
        ASSERT_LE(measured(x, y), 3.0F);
        flying += measured(x, y) != exact;
      }
  }
  const double beside = 2.0 * kHeight * frames;
  EXPECT_NEAR(flying / beside, 0.35, 4 * std::sqrt(0.35 * 0.65 / beside));
}

TEST(MeasureDepth, PatchesMissBesideEdgesOnly) {
  const SensorModel model{.edge_dropout_share = 0.1};
  int missing = 0;
  const Image<float> measured = MeasureDepth(model, Step(100, 1.5F, 3.0F), 1, 0);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      missing += measured(x, y) == 0;
      if (x < 99 || x > 101) {
        EXPECT_GT(measured(x, y), 0);
      }
    }
  // 480 pixels start a patch of mean area 2.5 with probability 0.1; patches overlap a little.
  EXPECT_GT(missing, 70);
  EXPECT_LT(missing, 150);
}

TEST(MeasureDepth, DarkAndGrazingSurfacesAreMissing) {
  const SensorModel model{.least_echo = 0.01};
  const auto missing_share = [&](float infrared) {
    SurfaceTruth truth = Step(0, 2.0F, 2.0F);
    truth.infrared.Fill(infrared);
    const Image<float> measured = MeasureDepth(model, truth, 1, 0);
    int missing = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) missing += measured(x, y) == 0;
    return missing / static_cast<double>(kWidth * kHeight);
  };
  EXPECT_EQ(missing_share(0.009F), 1.0);
  EXPECT_NEAR(missing_share(0.015F), 0.5, 0.02);
  EXPECT_EQ(missing_share(0.021F), 0.0);
}

TEST(MeasureDepth, NothingStaysNothing) {
  const Image<float> measured = MeasureDepth(Kinect2Sensor(), Step(100, 0.0F, 2.0F), 1, 0);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < 100; ++x) EXPECT_EQ(measured(x, y), 0);
}

TEST(Sensor, PerfectSensorChangesNothing) {
  const SurfaceTruth truth = Step(100, 1.5F, 3.0F);
  const Image<float> depth = MeasureDepth(PerfectSensor(), truth, 1, 0);
  EXPECT_TRUE(std::equal(depth.data(), depth.data() + depth.pixel_count(), truth.depth_m.data()));
  const Image<Rgb8> color(kWidth, kHeight, Rgb8{10, 128, 250});
  const Image<Rgb8> recorded = MeasureColor(PerfectSensor(), color, 1, 0);
  EXPECT_TRUE(std::equal(color.data(), color.data() + color.pixel_count(), recorded.data()));
}

// The stated standard deviation, plus 1/12 of a level squared from rounding.
TEST(MeasureColor, NoiseIsAsStated) {
  const SensorModel model{.color_noise_levels = 1.0, .color_shot_noise = 0.1};
  const Image<Rgb8> recorded = MeasureColor(model, Image<Rgb8>(kWidth, kHeight, Rgb8{100, 100, 100}), 1, 0);
  double square = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) square += std::pow(recorded(x, y).g - 100.0, 2);
  EXPECT_NEAR(square / (kWidth * kHeight), 4.0 + 1 / 12.0, 0.1);
}

TEST(Sensor, NoiseIsSetBySeedAndFrameAlone) {
  const SurfaceTruth truth = Step(100, 1.5F, 3.0F);
  const auto same = [](const Image<float>& a, const Image<float>& b) {
    return std::equal(a.data(), a.data() + a.pixel_count(), b.data());
  };
  const Image<float> measured = MeasureDepth(Kinect2Sensor(), truth, 5, 3);
  EXPECT_TRUE(same(measured, MeasureDepth(Kinect2Sensor(), truth, 5, 3)));
  EXPECT_FALSE(same(measured, MeasureDepth(Kinect2Sensor(), truth, 6, 3)));
  EXPECT_FALSE(same(measured, MeasureDepth(Kinect2Sensor(), truth, 5, 4)));
}

TEST(SensorModel, ValidateNamesTheField) {
  EXPECT_TRUE(Kinect2Sensor().Validate().ok());
  EXPECT_THAT(SensorModel{.flying_share = 1.5}.Validate().message(),
              testing::HasSubstr("flying_share = 1.5, must be between"));
  EXPECT_THAT(SensorModel{.noise_a_m = std::nan("")}.Validate().message(), testing::HasSubstr("noise_a_m = nan"));
  EXPECT_THAT(SensorByName("kinect1").status().message(), testing::HasSubstr("must be kinect2 or none"));
}

TEST(DepthClock, ReadsOffsetAndDrift) {
  const DepthClock clock{.offset_s = 0.010, .drift_ppm = 50};
  EXPECT_DOUBLE_EQ(clock.Reading(0), 0.010);
  EXPECT_NEAR(clock.Reading(100), 100.015, 1e-12);
}

}  // namespace
}  // namespace depthtween
