// Errors of scene flow against arithmetic by hand.
#include "core/metrics/scene_flow_errors.h"

#include <cmath>
#include <vector>

#include "core/metrics/regions.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kFlowWidth = 24, kFlowHeight = 16;

struct Field {
  Image<Flow2> flow{kFlowWidth, kFlowHeight};
  Image<Float3> motion{kFlowWidth, kFlowHeight};
  Image<uint8_t> valid{kFlowWidth, kFlowHeight, 1};
  MotionField View() const { return {flow, motion, valid}; }
};

// Four errors whose statistics are done by hand: 3-4-5 triangles of 1, 6, 19 and 40 cm on a motion of 2 m.
TEST(SceneFlowErrors, EqualsArithmeticByHand) {
  SceneFlowErrors errors;
  for (const float m : {0.01F, 0.06F, 0.19F, 0.4F})
    errors.Add({0.6F * m, 0.8F * m, 2.0F}, {3.0F, 4.0F}, {0.0F, 0.0F, 2.0F}, {0.0F, 0.0F});
  const SceneFlowScore score = errors.Score();
  EXPECT_EQ(score.pixels, 4);
  EXPECT_NEAR(score.epe3d_m, 0.66 / 4, 1e-6);
  EXPECT_NEAR(score.rmse_v_m, std::sqrt((0.0001 + 0.0036 + 0.0361 + 0.16) / 4), 1e-6);
  EXPECT_NEAR(score.epe2d_px, 5.0, 1e-6);
  EXPECT_NEAR(score.aae_flow_deg, std::atan(5.0) * 180 / M_PI, 1e-6);
  EXPECT_EQ(score.accurate_strict, 0.5);    // 1 cm; 6 cm is 3 % of 2 m
  EXPECT_EQ(score.accurate_relaxed, 0.75);  // 19 cm is 9.5 %
  EXPECT_EQ(score.outliers, 0.25);          // 40 cm; 19 cm is below 10 %
}

// Angles of a ten-thousandth of a degree survive: the motion of a still scene is that small. (S, 1) with S = 1e-6 m.
TEST(SceneFlowErrors, KeepsSmallAngles) {
  SceneFlowErrors errors;
  errors.Add({1e-6F, 0.0F, 0.0F}, {}, {}, {});
  EXPECT_NEAR(errors.Score().aae_motion_deg, 1e-6 * 180 / M_PI, 1e-9);
}

TEST(SceneFlowErrors, NothingScoresZero) {
  const SceneFlowScore score = SceneFlowErrors().Score();
  EXPECT_EQ(score.pixels, 0);
  EXPECT_EQ(score.epe3d_m, 0.0);
}

// A wall with a step at x = 12; the right half is hidden in the second frame. One method errs by 1 cm where hidden
// only, the other leaves a column out: counts and errors of every region follow from that.
TEST(SceneFlowComparison, ScoresCommonPixelsByRegion) {
  Field truth, exact, wrong;
  Image<float> depth(kFlowWidth, kFlowHeight, 1.0F);
  Image<uint8_t> hidden(kFlowWidth, kFlowHeight);
  for (int y = 0; y < kFlowHeight; ++y)
    for (int x = 0; x < kFlowWidth; ++x) {
      if (x >= 12) depth(x, y) = 2.0F, hidden(x, y) = 255, wrong.motion(x, y) = {0.0F, 0.01F, 0.0F};
      if (x < 6) truth.flow(x, y) = exact.flow(x, y) = wrong.flow(x, y) = {1.0F, 0.0F};
      if (x == 20) exact.valid(x, y) = 0;
    }
  truth.valid(0, 0) = 0;
  depth(1, 0) = 9.0F;  // too far

  SceneFlowComparison comparison({"exact", "wrong"});
  comparison.Add({truth.View(), depth, hidden}, std::vector<MotionField>{exact.View(), wrong.View()}, kFarthestTruthM);
  const auto scores = comparison.Scores();
  ASSERT_EQ(scores.size(), 2U);
  const double with_truth = kFlowWidth * kFlowHeight - 2;
  EXPECT_NEAR(scores[0].completeness, (with_truth - kFlowHeight) / with_truth, 1e-12);
  EXPECT_EQ(scores[1].completeness, 1.0);
  for (const auto& score : scores) {
    EXPECT_EQ(score[MotionRegion::kAll].pixels, kFlowWidth * kFlowHeight - 2 - kFlowHeight);
    EXPECT_EQ(score[MotionRegion::kVisible].pixels, 12 * kFlowHeight - 2);
    EXPECT_EQ(score[MotionRegion::kHidden].pixels, 11 * kFlowHeight);
    EXPECT_EQ(score[MotionRegion::kMoving].pixels, 6 * kFlowHeight - 2);
    // 4 px beside the jump between columns 11 and 12, and around the far pixel.
    EXPECT_GE(score[MotionRegion::kNearJumps].pixels, 10 * kFlowHeight);
    EXPECT_LE(score[MotionRegion::kNearJumps].pixels, 10 * kFlowHeight + 6 * 6);
  }
  EXPECT_EQ(scores[0][MotionRegion::kAll].epe3d_m, 0.0);
  EXPECT_EQ(scores[1][MotionRegion::kVisible].epe3d_m, 0.0);
  EXPECT_NEAR(scores[1][MotionRegion::kHidden].epe3d_m, 0.01, 1e-6);
}

// A plane at 2 m moves 3 px right and to 1 m, in front of what was there; the colours are the columns. The right motion
// carries depth and colour exactly; standing still gets both wrong.
TEST(ScoreTransfer, TellsRightMotionFromNone) {
  const Image<float> from_m(kFlowWidth, kFlowHeight, 2.0F), to_m(kFlowWidth, kFlowHeight, 1.0F);
  Image<Rgb8> from(kFlowWidth, kFlowHeight), to(kFlowWidth, kFlowHeight);
  Field right, none;
  for (int y = 0; y < kFlowHeight; ++y)
    for (int x = 0; x < kFlowWidth; ++x) {
      from(x, y).r = static_cast<uint8_t>(10 * x);
      to(x, y).r = static_cast<uint8_t>(10 * std::max(x - 3, 0));
      right.flow(x, y) = {3.0F, 0.0F};
      right.motion(x, y) = {0.0F, 0.0F, -1.0F};
    }
  const std::vector<std::string> names = {"right", "none"};
  const std::vector<MotionField> fields = {right.View(), none.View()};
  const auto scores = ScoreTransfer({from, from_m}, {to, to_m}, names, fields);
  EXPECT_EQ(scores[0].pixels, (kFlowWidth - 3) * kFlowHeight);
  EXPECT_EQ(scores[0].depth_error, 0.0);
  EXPECT_EQ(scores[0].color_error, 0.0);
  EXPECT_NEAR(scores[0].coverage, (kFlowWidth - 3.0) / kFlowWidth, 1e-12);
  EXPECT_EQ(scores[1].depth_error, kMostTransferError);
  EXPECT_EQ(scores[1].depth_outliers, 1.0);
  EXPECT_NEAR(scores[1].color_error, 10.0, 1e-9);
  EXPECT_EQ(scores[1].coverage, 1.0);
}

}  // namespace
}  // namespace depthtween
