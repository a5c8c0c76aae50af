#include "core/metrics/scores.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "core/metrics/regions.h"

namespace depthtween {
namespace {

constexpr double kMmPerM = 1000.0;
constexpr double kLowestSigmaM = 1e-5;  // sigmas below share the first reliability bin
constexpr int kSparsificationSteps = 100;

double Ratio(double part, double whole) { return whole > 0.0 ? part / whole : 0.0; }

double Mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (double value : values) sum += value;
  return Ratio(sum, static_cast<double>(values.size()));
}

// RMSE in mm of what is left after taking away the largest keys, by shares of 1/kSparsificationSteps. Pixels of one bin
// leave evenly: equal sigmas say nothing about which pixel is worse.
std::vector<double> SparsificationCurve(const LogHistogram& histogram) {
  std::vector<double> curve;
  if (histogram.count() == 0) return curve;
  double left = 0.0, squares = 0.0;
  size_t bin = 0;
  const auto& bins = histogram.bins();
  for (int step = kSparsificationSteps - 1; step >= 0; --step) {  // from the surest pixels up to all
    const double keep =
        static_cast<double>(histogram.count()) * (1.0 - static_cast<double>(step) / kSparsificationSteps);
    while (bin < bins.size() && left + static_cast<double>(bins[bin].count) <= keep) {
      left += static_cast<double>(bins[bin].count);
      squares += bins[bin].payload_sum;
      ++bin;
    }
    double part = 0.0;
    if (bin < bins.size() && bins[bin].count > 0)
      part = (keep - left) * bins[bin].payload_sum / static_cast<double>(bins[bin].count);
    curve.push_back(std::sqrt((squares + part) / keep) * kMmPerM);
  }
  std::reverse(curve.begin(), curve.end());
  return curve;
}

}  // namespace

void DepthErrors::Add(float error_m) {
  const float magnitude = std::abs(error_m);
  magnitudes_.Add(magnitude, 0.0);
  sum_m_ += magnitude;
  sum_squares_m2_ += static_cast<double>(magnitude) * magnitude;
  if (magnitude < 0.01F) ++within_1cm_;
  if (magnitude < 0.05F) ++within_5cm_;
}

DepthScore DepthErrors::Score() const {
  const auto count = static_cast<double>(magnitudes_.count());
  return {.pixels = magnitudes_.count(),
          .rmse_mm = std::sqrt(Ratio(sum_squares_m2_, count)) * kMmPerM,
          .mae_mm = Ratio(sum_m_, count) * kMmPerM,
          .median_mm = magnitudes_.Quantile(0.5) * kMmPerM,
          .within_1cm = Ratio(static_cast<double>(within_1cm_), count),
          .within_5cm = Ratio(static_cast<double>(within_5cm_), count)};
}

std::vector<double> DepthErrors::Curve() const {
  std::vector<double> shares;
  for (const double at_mm : kErrorCurveMm) shares.push_back(magnitudes_.ShareUpTo(static_cast<float>(at_mm / kMmPerM)));
  return shares;
}

void EdgeMatches::Add(ImageView<const float> truth_m, ImageView<const float> estimate_m) {
  assert(truth_m.SameSize(estimate_m));
  const Image<uint8_t> real = Silhouettes(truth_m), found = Silhouettes(estimate_m);
  const Image<uint8_t> near_real = DilateSquare(real, 1), near_found = DilateSquare(found, 1);
  for (int y = 0; y < truth_m.height(); ++y) {
    for (int x = 0; x < truth_m.width(); ++x) {
      true_ += real(x, y);
      true_matched_ += real(x, y) & near_found(x, y);
      found_ += found(x, y);
      found_matched_ += found(x, y) & near_real(x, y);
    }
  }
}

EdgeScore EdgeMatches::Score() const {
  EdgeScore score{.true_edges = true_, .found_edges = found_};
  score.precision = Ratio(static_cast<double>(found_matched_), static_cast<double>(found_));
  score.recall = Ratio(static_cast<double>(true_matched_), static_cast<double>(true_));
  score.f1 = Ratio(2.0 * score.precision * score.recall, score.precision + score.recall);
  return score;
}

void UncertaintyErrors::Add(float error_m, float sigma_m) {
  assert(sigma_m > 0.0F);
  const float magnitude = std::abs(error_m);
  const double squared = static_cast<double>(magnitude) * magnitude;
  for (size_t i = 0; i < kCoverageAt.size(); ++i)
    if (magnitude < kCoverageAt[i] * sigma_m) ++covered_[i];
  const int bin = static_cast<int>(std::floor(2.0 * std::log2(sigma_m / kLowestSigmaM)));
  SigmaBin& sigma_bin = by_sigma_[std::clamp(bin, 0, kSigmaBins - 1)];
  ++sigma_bin.pixels;
  sigma_bin.sum_sigma2 += static_cast<double>(sigma_m) * sigma_m;
  sigma_bin.sum_error2 += squared;
  sigmas_.Add(sigma_m, squared);
  errors_.Add(magnitude, squared);
}

UncertaintyScore UncertaintyErrors::Score() const {
  UncertaintyScore score{.pixels = sigmas_.count()};
  if (score.pixels == 0) return score;
  const auto count = static_cast<double>(score.pixels);
  for (size_t i = 0; i < kCoverageAt.size(); ++i) {
    const double k = kCoverageAt[i];
    score.coverage.push_back(
        {.k = k, .share = static_cast<double>(covered_[i]) / count, .gaussian = std::erf(k / std::sqrt(2.0))});
    score.mean_coverage_gap +=
        std::abs(score.coverage.back().share - score.coverage.back().gaussian) / kCoverageAt.size();
  }
  for (const SigmaBin& bin : by_sigma_) {
    if (bin.pixels == 0) continue;
    const auto pixels = static_cast<double>(bin.pixels);
    score.reliability.push_back({.pixels = bin.pixels,
                                 .sigma_mm = std::sqrt(bin.sum_sigma2 / pixels) * kMmPerM,
                                 .rmse_mm = std::sqrt(bin.sum_error2 / pixels) * kMmPerM});
  }
  score.sparsification_mm = SparsificationCurve(sigmas_);
  score.oracle_mm = SparsificationCurve(errors_);
  score.sparsification_area_mm = Mean(score.sparsification_mm);
  score.oracle_area_mm = Mean(score.oracle_mm);
  return score;
}

}  // namespace depthtween
