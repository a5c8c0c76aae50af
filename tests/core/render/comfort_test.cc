// Angles by trigonometry, percentiles of depths that are written down.
#include "core/render/comfort.h"

#include <cmath>
#include <numbers>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kWidth = 100, kHeight = 50;

// d = 100 * 0.1 * (1/z - 1/2) px of 100: 1/z = 0.5 + d / 10.
StereoGeometry Geometry() {
  StereoGeometry geometry;
  geometry.focal_px = 100.0, geometry.baseline_m = 0.1, geometry.convergence_m = 2.0;
  return geometry;
}
float DepthFor(double disparity_px) { return static_cast<float>(1 / (0.5 + disparity_px / 10)); }

// The outer tenth left of the middle at `near_px`, a tenth right of it at `far_px`, the rest on the screen.
Image<float> Frame(double near_px, double far_px) {
  Image<float> depth_m(kWidth, kHeight, 2.0F);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < 10; ++x) depth_m(30 + x, y) = DepthFor(near_px), depth_m(60 + x, y) = DepthFor(far_px);
  return depth_m;
}

// On a screen 1 m wide at 3 m, 2 % of the width crossed brings eyes 63 mm apart to turn in as for 83 mm.
TEST(Comfort, AnglesOfAScreen) {
  const Screen screen;
  const double deg = 180 / std::numbers::pi;
  EXPECT_NEAR(VergenceDeg(0.02, screen), 2 * deg * (std::atan(0.083 / 6) - std::atan(0.063 / 6)), 1e-12);
  EXPECT_NEAR(VergenceDeg(-0.063, screen), -2 * deg * std::atan(0.063 / 6), 1e-12) << "parallel eyes";
  EXPECT_EQ(VergenceDeg(0.0, screen), 0.0);
}

TEST(Comfort, PercentilesOfDisparity) {
  ComfortStatistics statistics;
  statistics.AddFrame(Frame(2.0, -3.0), Geometry());
  const ComfortReport report = statistics.Report({});
  EXPECT_EQ(report.frames, 1);
  EXPECT_NEAR(report.near_percent, 2.0, 0.011);
  EXPECT_NEAR(report.far_percent, -3.0, 0.011);
  EXPECT_NEAR(report.near_deg, VergenceDeg(report.near_percent / 100, {}), 1e-9);
  EXPECT_LT(report.far_deg, 0);
  EXPECT_FALSE(report.eyes_diverge);
}

// Applying the recommended strength leads to a recommendation of 1.
TEST(Comfort, RecommendedStrengthIsWhereItBecomesComfortable) {
  ComfortStatistics strong, weakened;
  strong.AddFrame(Frame(4.0, -4.5), Geometry());
  const ComfortReport report = strong.Report({.width_m = 2.0, .distance_m = 2.0});
  EXPECT_TRUE(report.eyes_diverge) << "9 cm apart on the screen";
  ASSERT_LT(report.recommended_strength, 1.0);
  StereoGeometry geometry = Geometry();
  const double strength = report.recommended_strength;
  geometry.baseline_m *= strength;
  weakened.AddFrame(Frame(4.0, -4.5), geometry);
  const ComfortReport after = weakened.Report({.width_m = 2.0, .distance_m = 2.0});
  EXPECT_NEAR(after.recommended_strength, 1.0, 0.02);
  EXPECT_FALSE(after.eyes_diverge);
  EXPECT_LE(std::abs(after.far_deg), kComfortableDeg + 0.02);
}

TEST(Comfort, CountsFramesThatCutWhatStandsBeforeTheWindow) {
  Image<float> cut(kWidth, kHeight, 2.0F);
  for (int y = 10; y < 20; ++y) cut(0, y) = DepthFor(4.0);
  ComfortStatistics statistics;
  statistics.AddFrame(cut, Geometry());
  statistics.AddFrame(Frame(4.0, -3.0), Geometry());  // in front, but away from the sides
  EXPECT_EQ(statistics.Report({}).window_violations, 1);
  StereoGeometry floating = Geometry();
  floating.window_px = 4;
  ComfortStatistics windowed;
  windowed.AddFrame(cut, floating);
  EXPECT_EQ(windowed.Report({}).window_violations, 0);
}

// Batches merged give the bits of one run, also through JSON.
TEST(Comfort, PartsMerge) {
  ComfortStatistics whole, first, second;
  whole.AddFrame(Frame(2.0, -3.0), Geometry());
  whole.AddFrame(Frame(5.0, -1.0), Geometry());
  first.AddFrame(Frame(2.0, -3.0), Geometry());
  second.AddFrame(Frame(5.0, -1.0), Geometry());
  const auto read = ComfortStatistics::FromJson(second.ToJson());
  ASSERT_TRUE(read.ok());
  first.Merge(*read);
  EXPECT_EQ(first.ToJson(), whole.ToJson());
  EXPECT_EQ(first.Report({}).ToJson(), whole.Report({}).ToJson());
  EXPECT_FALSE(ComfortStatistics::FromJson({{"frames", 1}}).ok());
  EXPECT_FALSE(
      ComfortStatistics::FromJson({{"frames", 1}, {"window_violations", 0}, {"disparity", {{99999, 1}}}}).ok());
}

TEST(Comfort, NothingKnownIsNothingInFront) {
  ComfortStatistics statistics;
  statistics.AddFrame(Image<float>(kWidth, kHeight), Geometry());
  const ComfortReport report = statistics.Report({});
  EXPECT_EQ(report.near_percent, 0.0);
  EXPECT_EQ(report.far_deg, 0.0);
}

TEST(Screen, NamesTheField) {
  EXPECT_TRUE(Screen{}.Validate().ok());
  EXPECT_THAT(std::string(Screen{.width_m = 0}.Validate().message()), testing::HasSubstr("screen_width_m = 0"));
  EXPECT_THAT(std::string(Screen{.distance_m = -1}.Validate().message()),
              testing::HasSubstr("viewing_distance_m = -1"));
}

}  // namespace
}  // namespace depthtween
