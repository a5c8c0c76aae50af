// Scores against arithmetic by hand, and against sums and sorting over whole lists.
#include "core/metrics/scores.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// Four errors whose statistics are done by hand.
TEST(DepthErrors, EqualsArithmeticByHand) {
  DepthErrors errors;
  for (float error_m : {0.004F, -0.02F, 0.03F, -0.3F}) errors.Add(error_m);
  const DepthScore score = errors.Score();
  EXPECT_EQ(score.pixels, 4);
  EXPECT_NEAR(score.rmse_mm, 1000 * std::sqrt((0.004 * 0.004 + 0.02 * 0.02 + 0.03 * 0.03 + 0.3 * 0.3) / 4), 1e-4);
  EXPECT_NEAR(score.mae_mm, 88.5, 1e-4);
  EXPECT_NEAR(score.median_mm, 20.0, 0.04);
  EXPECT_EQ(score.within_1cm, 0.25);
  EXPECT_EQ(score.within_5cm, 0.75);
  const std::vector<double> curve = errors.Curve();
  ASSERT_EQ(curve.size(), kErrorCurveMm.size());
  for (size_t i = 0; i < curve.size(); ++i)
    EXPECT_EQ(curve[i], 0.25 * ((kErrorCurveMm[i] >= 4) + (kErrorCurveMm[i] >= 20) + (kErrorCurveMm[i] >= 30) +
                                (kErrorCurveMm[i] >= 300)))
        << kErrorCurveMm[i];
}

// Sums and sorting over the whole list are the definition; the accumulator sees one error at a time.
TEST(DepthErrors, EqualsDirectComputation) {
  std::mt19937 random(3);
  std::normal_distribution<float> noise(0.0F, 0.04F);
  DepthErrors errors;
  std::vector<double> magnitudes;
  double squares = 0.0, sum = 0.0;
  for (int i = 0; i < 9999; ++i) {
    const float error_m = noise(random);
    errors.Add(error_m);
    magnitudes.push_back(std::abs(error_m));
    squares += magnitudes.back() * magnitudes.back();
    sum += magnitudes.back();
  }
  std::sort(magnitudes.begin(), magnitudes.end());
  const DepthScore score = errors.Score();
  EXPECT_NEAR(score.rmse_mm, 1000 * std::sqrt(squares / 9999), 1e-6);
  EXPECT_NEAR(score.mae_mm, 1000 * sum / 9999, 1e-6);
  EXPECT_NEAR(score.median_mm / (1000 * magnitudes[4999]), 1.0, 0.002);
}

TEST(Scores, OfNothingAreZeroNotNan) {
  const DepthScore depth = DepthErrors().Score();
  EXPECT_EQ(depth.pixels, 0);
  EXPECT_EQ(depth.rmse_mm, 0.0);
  EXPECT_EQ(depth.median_mm, 0.0);
  EXPECT_EQ(EdgeMatches().Score().f1, 0.0);
  EXPECT_EQ(UncertaintyErrors().Score().sparsification_area_mm, 0.0);
}

// Left of column `edge` 1 m, from there on 2 m.
Image<float> DepthStep(int edge) {
  Image<float> depth_m(30, 10, 2.0F);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < edge; ++x) depth_m(x, y) = 1.0F;
  return depth_m;
}

// An edge off by one pixel is found, by two it is both missed and wrong: that is what 1 px means.
TEST(EdgeMatches, ToleratesOnePixel) {
  for (int shift : {0, 1, 2}) {
    EdgeMatches matches;
    matches.Add(DepthStep(15), DepthStep(15 + shift));
    const EdgeScore score = matches.Score();
    EXPECT_EQ(score.true_edges, 10);
    EXPECT_EQ(score.f1, shift <= 1 ? 1.0 : 0.0) << shift;
  }
}

// All that is found is true (precision 1); of 10 rows of true edge 5 are found and one lies within 1 px of them (recall
// 6/10): F1 = 2 * 1 * 0.6 / 1.6.
TEST(EdgeMatches, IsTheHarmonicMeanOfPrecisionAndRecall) {
  Image<float> half = DepthStep(15);
  for (int y = 5; y < 10; ++y)
    for (int x = 0; x < 30; ++x) half(x, y) = 0.0F;
  EdgeMatches matches;
  matches.Add(DepthStep(15), half);
  const EdgeScore score = matches.Score();
  EXPECT_EQ(score.precision, 1.0);
  EXPECT_NEAR(score.recall, 0.6, 1e-12);
  EXPECT_NEAR(score.f1, 0.75, 1e-12);
}

// Errors drawn from the predicted Gaussians are calibrated by construction: coverage is erf, each bin's RMSE its sigma.
TEST(UncertaintyErrors, KnowsAPerfectPrediction) {
  std::mt19937 random(11);
  std::normal_distribution<float> unit;
  std::uniform_real_distribution<float> log_sigma(std::log(0.001F), std::log(0.1F));
  UncertaintyErrors errors;
  for (int i = 0; i < 200000; ++i) {
    const float sigma_m = std::exp(log_sigma(random));
    errors.Add(sigma_m * unit(random), sigma_m);
  }
  const UncertaintyScore score = errors.Score();
  EXPECT_EQ(score.pixels, 200000);
  for (const auto& at : score.coverage) EXPECT_NEAR(at.share, at.gaussian, 0.005) << at.k;
  EXPECT_LT(score.mean_coverage_gap, 0.005);
  ASSERT_GE(score.reliability.size(), 13U);  // 6.6 octaves, two bins each
  for (const auto& bin : score.reliability) EXPECT_NEAR(bin.rmse_mm / bin.sigma_mm, 1.0, 0.05) << bin.sigma_mm;
}

// Ten thousand errors of 0, 1, .., 9 mm: taking away the largest tenth i times leaves 0..9-i, whose RMSE is arithmetic.
// A sigma in the same order sparsifies as well as the oracle; a constant sigma cannot sparsify at all.
TEST(UncertaintyErrors, SparsificationFollowsTheOrderOfSigma) {
  UncertaintyErrors ordered, constant;
  for (int i = 0; i < 10000; ++i) {
    const float error_m = 0.001F * static_cast<float>(i % 10);
    ordered.Add(error_m, 0.01F + 2 * error_m);
    constant.Add(error_m, 0.02F);
  }
  const auto rmse_mm = [](int largest) {
    double squares = 0.0;
    for (int e = 0; e <= largest; ++e) squares += e * e;
    return std::sqrt(squares / (largest + 1));
  };
  const UncertaintyScore a = ordered.Score(), b = constant.Score();
  ASSERT_EQ(a.sparsification_mm.size(), 100U);
  for (int tenth = 0; tenth < 10; ++tenth) {
    EXPECT_NEAR(a.sparsification_mm[10 * tenth], rmse_mm(9 - tenth), 1e-4) << tenth;
    EXPECT_NEAR(a.oracle_mm[10 * tenth], rmse_mm(9 - tenth), 1e-4) << tenth;
    EXPECT_NEAR(b.sparsification_mm[10 * tenth], rmse_mm(9), 1e-4) << tenth;
  }
  EXPECT_NEAR(a.sparsification_area_mm, a.oracle_area_mm, 1e-6);
  EXPECT_NEAR(b.sparsification_area_mm, rmse_mm(9), 1e-4);
}

}  // namespace
}  // namespace depthtween
