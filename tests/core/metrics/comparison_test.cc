// Scores of methods on depth steps whose errors are counted by hand.
#include "core/metrics/comparison.h"

#include <cmath>
#include <limits>

#include "core/metrics/sensor_floor.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kWidth = 30, kHeight = 10;

// Left of column `edge` 1 m, from there on 2 m.
Image<float> Step(int edge) {
  Image<float> depth_m(kWidth, kHeight, 2.0F);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < edge; ++x) depth_m(x, y) = 1.0F;
  return depth_m;
}

// An edge one pixel off: one of 30 columns is wrong by 1 m, all of it in the band of 10 columns.
TEST(Comparison, SplitsAShiftedEdgeByRegion) {
  Comparison comparison({"shifted"});
  const Image<float> truth_m = Step(15), shifted_m = Step(16);
  ASSERT_TRUE(comparison.AddFrame({.color_index = 1, .depth_m = truth_m}, {{{.depth_m = shifted_m}}}).ok());
  const ComparisonScore score = comparison.Score();
  const MethodScore& method = score.methods[0];
  EXPECT_EQ(score.truth_pixels, 300);
  EXPECT_EQ(score.common_pixels, 300);
  EXPECT_NEAR(method[Region::kAll].rmse_mm, 1000 / std::sqrt(30.0), 1e-3);
  EXPECT_NEAR(method[Region::kEdgeBand].rmse_mm, 1000 / std::sqrt(10.0), 1e-3);
  EXPECT_EQ(method[Region::kEdgeBand].pixels, 100);
  EXPECT_EQ(method[Region::kInterior].rmse_mm, 0.0);
  EXPECT_EQ(method[Region::kInterior].pixels, 200);
  EXPECT_EQ(method[Region::kMoving].pixels, 0);
  EXPECT_EQ(method.edges.f1, 1.0);
  EXPECT_EQ(method.completeness, 1.0);
  EXPECT_FALSE(method.flicker_mm.has_value());
  EXPECT_NEAR(score.frames[0].rmse_mm[0], method[Region::kAll].rmse_mm, 1e-9);
}

// The method that leaves its one wrong column out gains nothing: that column is then scored for nobody.
TEST(Comparison, ScoresOnlyPixelsThatAllMethodsFill) {
  Comparison comparison({"full", "holey"});
  Image<float> truth_m = Step(15), full_m = Step(16), holey_m = Step(15);
  for (int y = 0; y < kHeight; ++y) holey_m(15, y) = 0.0F;
  truth_m(0, 0) = 0.0F;                                    // unknown
  truth_m(29, 9) = 9.0F;                                   // too far
  full_m(3, 3) = std::numeric_limits<float>::quiet_NaN();  // NaN is no answer
  const MethodFrame methods[] = {{.depth_m = full_m}, {.depth_m = holey_m}};
  ASSERT_TRUE(comparison.AddFrame({.color_index = 1, .depth_m = truth_m}, methods).ok());
  const ComparisonScore score = comparison.Score();
  EXPECT_EQ(score.truth_pixels, 298);
  EXPECT_EQ(score.common_pixels, 287);
  for (const MethodScore& method : score.methods) EXPECT_EQ(method[Region::kAll].rmse_mm, 0.0) << method.name;
  EXPECT_NEAR(score.methods[0].completeness, 297.0 / 298, 1e-12);
  EXPECT_NEAR(score.methods[1].completeness, 288.0 / 298, 1e-12);
}

// Pooled: 300 pixels at 10 mm and 100 at 30 mm are one set of 400.
TEST(Comparison, PoolsOverFramesOfUnequalSupport) {
  Comparison comparison({"m"});
  Image<float> truth_m(kWidth, kHeight, 1.0F);
  const Image<float> first_m(kWidth, kHeight, 1.01F), second_m(kWidth, kHeight, 1.03F);
  ASSERT_TRUE(comparison.AddFrame({.color_index = 1, .depth_m = truth_m}, {{{.depth_m = first_m}}}).ok());
  for (int y = 0; y < kHeight; ++y)
    for (int x = 10; x < kWidth; ++x) truth_m(x, y) = 0.0F;
  ASSERT_TRUE(comparison.AddFrame({.color_index = 2, .depth_m = truth_m}, {{{.depth_m = second_m}}}).ok());
  const ComparisonScore score = comparison.Score();
  EXPECT_NEAR(score.methods[0][Region::kAll].rmse_mm, std::sqrt((300 * 100.0 + 100 * 900.0) / 400), 1e-3);
  EXPECT_NEAR(score.methods[0][Region::kAll].mae_mm, 15.0, 1e-3);
}

// The right half moves by 2 px, its last five columns by 5, the left stands; two columns were hidden. The truth moves
// along by 5 cm a frame; one method follows it with a constant bias, which is error but not flicker, the other stands
// still, which is the reverse.
TEST(Comparison, UsesTrueMotionWhereGiven) {
  Image<Flow2> flow(kWidth, kHeight);
  Image<uint8_t> valid(kWidth, kHeight, 1), hidden(kWidth, kHeight), unseen(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 15; x < kWidth; ++x) flow(x, y) = {x < 25 ? 2.0F : 5.0F, 0.0F};
    unseen(14, y) = unseen(15, y) = 1;
    valid(0, y) = 0;
  }
  const Image<Rgb8> grey(kWidth, kHeight, Rgb8{90, 90, 90});
  Comparison comparison({"biased", "still"});
  for (int frame = 1; frame <= 3; ++frame) {
    const float z = 1.0F + 0.05F * static_cast<float>(frame);
    const Image<float> truth_m(kWidth, kHeight, z), biased_m(kWidth, kHeight, z + 0.02F),
        still_m(kWidth, kHeight, 1.1F);
    const MethodFrame methods[] = {{.depth_m = biased_m}, {.depth_m = still_m}};
    const TruthFrame truth{.color_index = frame,
                           .depth_m = truth_m,
                           .motion = {.flow_px = flow, .valid = valid, .hidden_in_next = hidden},
                           .unseen = unseen,
                           .color = grey};
    ASSERT_TRUE(comparison.AddFrame(truth, methods).ok());
  }
  const ComparisonScore score = comparison.Score();
  const MethodScore& biased = score.methods[0];
  EXPECT_EQ(biased[Region::kFast].pixels, 3 * 50);
  EXPECT_EQ(biased[Region::kUntextured].pixels, 3 * kWidth * kHeight);
  EXPECT_EQ(biased[Region::kMoving].pixels, 3 * 150);
  EXPECT_EQ(biased[Region::kStatic].pixels, 3 * 140);
  EXPECT_EQ(biased[Region::kDisoccluded].pixels, 3 * 20);
  EXPECT_NEAR(biased[Region::kMoving].rmse_mm, 20.0, 1e-3);
  EXPECT_NEAR(*biased.flicker_mm, 0.0, 1e-3);
  EXPECT_NEAR(*score.methods[1].flicker_mm, 50.0, 1e-3);
}

// A gap between scored frames is no change along one step of the flow.
TEST(Comparison, DoesNotTakeFlickerAcrossAGap) {
  const Image<Flow2> flow(kWidth, kHeight);
  const Image<uint8_t> valid(kWidth, kHeight, 1);
  const Image<float> truth_m(kWidth, kHeight, 1.0F);
  Comparison comparison({"m"});
  for (int frame : {1, 3, 5}) {
    const TruthFrame truth{.color_index = frame, .depth_m = truth_m, .motion = {.flow_px = flow, .valid = valid}};
    ASSERT_TRUE(comparison.AddFrame(truth, {{{.depth_m = truth_m}}}).ok());
  }
  EXPECT_FALSE(comparison.Score().methods[0].flicker_mm.has_value());
}

TEST(Comparison, RefusesOtherSizesAndSurvivesNothing) {
  Comparison comparison({"m"});
  const Image<float> truth_m(kWidth, kHeight, 1.0F), other_m(kWidth, kHeight + 1, 1.0F), empty_m(kWidth, kHeight);
  const absl::Status refused = comparison.AddFrame({.color_index = 1, .depth_m = truth_m}, {{{.depth_m = other_m}}});
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(refused.message(), testing::HasSubstr("m is 30 x 11, the truth 30 x 10"));
  ASSERT_TRUE(comparison.AddFrame({.color_index = 1, .depth_m = truth_m}, {{{.depth_m = empty_m}}}).ok());
  const ComparisonScore score = comparison.Score();
  EXPECT_EQ(score.common_pixels, 0);
  EXPECT_EQ(score.methods[0][Region::kAll].rmse_mm, 0.0);
  EXPECT_EQ(score.frames[0].rmse_mm[0], 0.0);
}

TEST(SensorFloor, IsTakenFromAnError) {
  // Two maps differ by the noise of both: 5 mm between an estimate and one map of 3 * sqrt(2) mm of floor leave 4.
  EXPECT_NEAR(LessTruthNoise(5, 3 * std::sqrt(2.0)), 4, 1e-9);
  EXPECT_EQ(LessTruthNoise(1, 3), 0);
}

// Depth alternates by 20 mm everywhere; on the left the colour changes too, so only the right may be compared.
TEST(SensorFloor, ComparesOnlyWhereColourStandsStill) {
  SensorFloor floor;
  for (int frame = 0; frame < 4; ++frame) {
    Image<Rgb8> color(kWidth, kHeight, Rgb8{100, 100, 100});
    Image<float> depth_m(kWidth, kHeight, frame % 2 == 0 ? 1.0F : 1.02F);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < 10; ++x) {
        color(x, y) = frame % 2 == 0 ? Rgb8{0, 0, 0} : Rgb8{200, 200, 200};
        depth_m(x, y) = frame % 2 == 0 ? 1.0F : 3.0F;
      }
    }
    ASSERT_TRUE(floor.Add(color, depth_m).ok());
  }
  const DepthScore score = floor.Score();
  EXPECT_NEAR(score.rmse_mm, 20.0, 1e-3);
  EXPECT_EQ(score.pixels, 3 * kHeight * (kWidth - 16));  // 10 columns, 2 of the mean's window, 4 of guard
  EXPECT_NEAR(floor.StillShare(), (kWidth - 16.0) / kWidth, 1e-12);
  EXPECT_FALSE(floor.Add(Image<Rgb8>(3, 3), Image<float>(3, 3)).ok());

  // A map after a restart is compared with none before it.
  floor.Restart();
  ASSERT_TRUE(floor.Add(Image<Rgb8>(3, 3), Image<float>(3, 3, 7.0F)).ok());
  EXPECT_EQ(floor.Score().pixels, score.pixels);
}

}  // namespace
}  // namespace depthtween
