// Pooled scores: add pixels one by one, frame after frame, and read the numbers at the end.
//
// Pooled means that every pixel of the clip counts the same; nothing is averaged over frames. Scores of nothing are 0
// with a count of 0, never NaN.
// Threads: values; guard concurrent writes.
#ifndef DEPTHTWEEN_CORE_METRICS_SCORES_H_
#define DEPTHTWEEN_CORE_METRICS_SCORES_H_

#include <array>
#include <cstdint>
#include <vector>

#include "core/base/image.h"
#include "core/metrics/log_histogram.h"

namespace depthtween {

struct DepthScore {
  int64_t pixels = 0;
  double rmse_mm = 0.0;
  double mae_mm = 0.0;
  double median_mm = 0.0;   // of the absolute error, to within 0.1 %
  double within_1cm = 0.0;  // share of pixels, [0,1]
  double within_5cm = 0.0;
};

// Where the distribution of errors is read off: four values an octave, from 1 mm to 4.096 m.
inline constexpr std::array kErrorCurveMm = [] {
  std::array<double, 49> at_mm = {};
  constexpr std::array kWithinOctave = {1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429};
  for (int i = 0; i < static_cast<int>(at_mm.size()); ++i)
    at_mm[i] = static_cast<double>(1 << (i / 4)) * kWithinOctave[i % 4];
  return at_mm;
}();

class DepthErrors {
 public:
  // Estimate minus truth, metres, finite.
  void Add(float error_m);
  DepthScore Score() const;
  // The distribution of absolute errors: the share of them that is at most kErrorCurveMm[i], to within 0.1 % of it.
  std::vector<double> Curve() const;

 private:
  LogHistogram magnitudes_;
  double sum_m_ = 0.0, sum_squares_m2_ = 0.0;
  int64_t within_1cm_ = 0, within_5cm_ = 0;
};

// How well silhouettes sit: F1 of silhouette pixels matched within 1 px (3x3).
struct EdgeScore {
  int64_t true_edges = 0, found_edges = 0;
  double precision = 0.0;  // share of found edges with a true one within 1 px
  double recall = 0.0;     // share of true edges with a found one within 1 px
  double f1 = 0.0;
};

class EdgeMatches {
 public:
  // Both maps should know the same pixels, so that a hole is neither an edge found nor one missed.
  void Add(ImageView<const float> truth_m, ImageView<const float> estimate_m);
  EdgeScore Score() const;

 private:
  int64_t true_ = 0, true_matched_ = 0, found_ = 0, found_matched_ = 0;
};

// Does the predicted standard deviation say how wrong a pixel is?
struct UncertaintyScore {
  int64_t pixels = 0;

  // Calibration: the share of pixels whose error is below k sigma, beside that of a Gaussian.
  struct Coverage {
    double k = 0.0, share = 0.0, gaussian = 0.0;
  };
  std::vector<Coverage> coverage;
  double mean_coverage_gap = 0.0;  // mean |share - gaussian|

  // Reliability: pixels by predicted sigma, two bins an octave. Calibrated means rmse == sigma.
  struct Reliability {
    int64_t pixels = 0;
    double sigma_mm = 0.0;  // root mean square of the predictions
    double rmse_mm = 0.0;
  };
  std::vector<Reliability> reliability;

  // Sparsification: RMSE of what is left when the share i/100 with the largest sigma is taken away, i = 0..99; and the
  // best possible curve, which takes away the largest errors. The area under a curve is its mean.
  std::vector<double> sparsification_mm, oracle_mm;
  double sparsification_area_mm = 0.0, oracle_area_mm = 0.0;
};

class UncertaintyErrors {
 public:
  // Metres; sigma_m > 0, finite.
  void Add(float error_m, float sigma_m);
  UncertaintyScore Score() const;

  static constexpr std::array kCoverageAt = {0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0};

 private:
  struct SigmaBin {
    int64_t pixels = 0;
    double sum_sigma2 = 0.0, sum_error2 = 0.0;
  };
  static constexpr int kSigmaBins = 60;

  std::array<int64_t, kCoverageAt.size()> covered_ = {};
  std::array<SigmaBin, kSigmaBins> by_sigma_ = {};
  LogHistogram sigmas_, errors_;  // payload: squared error
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_METRICS_SCORES_H_
