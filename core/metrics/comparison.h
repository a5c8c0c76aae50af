// Scores several methods against the same truth, frame by frame, in bounded memory.
//
// Methods are compared on the pixels that all of them fill: a method gains nothing by leaving hard pixels out. What
// each fills is told apart, as completeness. Scores are pooled over frames (scores.h) and split by region (regions.h).
#ifndef DEPTHTWEEN_CORE_METRICS_COMPARISON_H_
#define DEPTHTWEEN_CORE_METRICS_COMPARISON_H_

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/metrics/regions.h"
#include "core/metrics/scores.h"

namespace depthtween {

// Truth of one colour frame. Views may be empty where that truth is not available.
struct TruthFrame {
  int color_index = -1;
  ImageView<const float> depth_m;
  TrueMotion motion;                // to the next colour frame: for moving, fast, static and flicker
  ImageView<const uint8_t> unseen;  // nonzero: not seen by the key before (KeyVisibility)
  ImageView<const Rgb8> color;      // the frame itself: for untextured
};

struct MethodFrame {
  ImageView<const float> depth_m;  // 0 = not filled
  ImageView<const float> sigma_m;  // predicted standard deviation, 0 = unknown; empty: the method predicts none
};

struct MethodScore {
  std::string name;
  std::array<DepthScore, kRegions.size()> regions;  // indexed by Region; on common pixels
  std::vector<double> errors_below;                 // ErrorCurve of all common pixels
  EdgeScore edges;                                  // on common pixels
  double completeness = 0.0;                        // share of truth pixels that this method fills, [0,1]
  // Mean |change of the estimate along the true motion - change of the truth|, mm; none without true motion.
  std::optional<double> flicker_mm;
  UncertaintyScore uncertainty;  // pixels = 0 if the method predicts none

  const DepthScore& operator[](Region region) const { return regions[static_cast<size_t>(region)]; }
};

struct FrameScore {
  int color_index = -1;
  int64_t pixels = 0;           // common ones
  std::vector<double> rmse_mm;  // one for each method
};

struct ComparisonScore {
  int64_t truth_pixels = 0;   // known and not too far
  int64_t common_pixels = 0;  // of those, filled by all methods
  std::vector<MethodScore> methods;
  std::vector<FrameScore> frames;
};

class Comparison {
 public:
  // Truth beyond `far_m` is not scored.
  explicit Comparison(std::vector<std::string> method_names, float far_m = kFarthestTruthM);

  // Frames in time order. One entry of `methods` for each name. InvalidArgument if a size differs from that of the
  // truth.
  absl::Status AddFrame(const TruthFrame& truth, std::span<const MethodFrame> methods);

  ComparisonScore Score() const;

 private:
  struct Method {
    std::string name;
    std::array<DepthErrors, kRegions.size()> errors;
    EdgeMatches edges;
    UncertaintyErrors uncertainty;
    int64_t filled = 0;
    double flicker_sum_m = 0.0;
    Image<float> previous_m;  // on common pixels
  };

  void AddFlicker(const Image<float>& truth_m, const std::vector<Image<float>>& estimates_m);

  std::vector<Method> methods_;
  const float far_m_;
  int64_t truth_pixels_ = 0, common_pixels_ = 0, flicker_pixels_ = 0;
  std::vector<FrameScore> frames_;
  // The frame before, for flicker: restricted to common pixels, and where each pixel goes.
  Image<float> previous_truth_m_;
  Image<Flow2> previous_flow_px_;
  Image<uint8_t> previous_followed_;  // flow known and the pixel seen in the next frame
  int previous_index_ = -1;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_METRICS_COMPARISON_H_
