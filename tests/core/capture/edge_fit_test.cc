// Edges are made for the test: how far each lies from its change of colour follows from causes that are chosen.
#include "core/capture/edge_fit.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// One key of edges all around, whose colour changes where `truth` says, within kReachPx of them.
Comparisons Made(const Causes& truth, int count) {
  Comparisons comparisons;
  for (int i = 0; i < count; ++i) {
    const double angle = 2.4 * i, nx = std::cos(angle), ny = std::sin(angle), speed = 0.3 * std::sin(1.7 * i);
    Comparison comparison;
    comparison.causes << -speed, -speed * 0.5, -speed * std::sin(0.9 * i), -1, -nx, -ny, -std::sin(0.31 * i), 0, 0;
    comparison.part = i % kParts;
    const double at = comparison.causes.dot(truth);
    for (int s = 0; s < kSamples; ++s) {
      const double off = kSampleStepPx * s - kReachPx - at;
      comparison.share[s] = static_cast<float>(0.3 * std::exp(-0.5 * off * off));
    }
    comparisons.push_back(comparison);
  }
  return comparisons;
}

TEST(EdgeFit, TellsTheCausesApart) {
  Causes truth = Causes::Zero();
  truth(kMiddle) = 3, truth(kRight) = 1.5, truth(kDown) = -0.8, truth(kOutside) = 0.5, truth(kLarger) = 0.7;
  EdgeFitOptions options;
  options.sigma(kGrowth) = 0;
  const EdgeFit fit = FitWithCovariance({Made(truth, 600)}, options);
  for (const Cause cause : {kMiddle, kRight, kDown, kOutside, kLarger})
    EXPECT_NEAR(fit.causes(cause), truth(cause), 0.05) << cause;
  EXPECT_EQ(fit.causes(kGrowth), 0);
  EXPECT_EQ(fit.covariance(kGrowth, kGrowth), 0);
  EXPECT_GT(fit.covariance(kRight, kRight), 0);
  EXPECT_NEAR(FitCauses({Made(truth, 600)}, options)(kRight), 1.5, 0.05);
}

// What was thought before holds back what few edges say.
TEST(EdgeFit, PriorsHoldBack) {
  Causes truth = Causes::Zero();
  truth(kRight) = 2;
  EdgeFitOptions options;
  options.sigma.setZero();
  options.sigma(kRight) = std::numeric_limits<double>::infinity();
  EXPECT_NEAR(FitCauses({Made(truth, 40)}, options)(kRight), 2, 0.1);
  options.sigma(kRight) = 0.2;
  EXPECT_LT(FitCauses({Made(truth, 40)}, options)(kRight), 0.5);
}

// Corrected by what was found, the displacement is that of the sum.
TEST(EdgeFit, CorrectsARegistration) {
  Causes causes = Causes::Zero();
  causes(kRight) = 2, causes(kLarger) = 1, causes(kNearX) = 3;
  const Registration corrected = Corrected({.right_px = 5, .reference_m = 2}, causes, 101);
  EXPECT_DOUBLE_EQ(corrected.right_px, 3);
  EXPECT_DOUBLE_EQ(corrected.scale, 1 - 1.0 / 50);
  // Twice as near: 3 px less.
  EXPECT_NEAR(corrected.Displacement(101, 101, 50, 50, 1).u, 0, 1e-6);
  EXPECT_NEAR(corrected.Displacement(101, 101, 50, 50, 2).u, 3, 1e-6);
  const DepthEdge edge = Registered({.x = 50, .y = 50, .near_m = 2}, corrected, 101, 101);
  EXPECT_NEAR(edge.x, 53, 1e-5);
}

TEST(EdgeFit, TakesTheMiddleDepth) {
  EXPECT_EQ(MedianNearM({}), 1.0);
  EXPECT_EQ(MedianNearM({{.near_m = 4}, {.near_m = 1}, {.near_m = 2}}), 2.0);
}

}  // namespace
}  // namespace depthtween
