// How far estimated scene flow is from the truth: 3-D motion in metres, its projection in pixels.
//
// Pooled as in scores.h: every pixel of every pair counts the same; scores of nothing are 0 with a count of 0.
// Shapes:   all images W x H, of one size.
// Threads:  values; guard concurrent writes.
// Source:   EPE, RMSE_V and AAE as in Huguet and Devernay, A Variational Method for Scene Flow Estimation from Stereo
//           Sequences, ICCV 2007; shares of accurate pixels and of outliers as in Liu, Qi and Guibas, FlowNet3D,
//           CVPR 2019, and Gu et al., HPLFlowNet, CVPR 2019.
#ifndef DEPTHTWEEN_CORE_METRICS_SCENE_FLOW_ERRORS_H_
#define DEPTHTWEEN_CORE_METRICS_SCENE_FLOW_ERRORS_H_

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/float3.h"
#include "core/base/image.h"
#include "core/metrics/log_histogram.h"
#include "core/sequence/rgbd_view.h"

namespace depthtween {

// Where pixels of the first frame go.
struct MotionField {
  ImageView<const Flow2> flow_px;
  ImageView<const Float3> motion_m;  // the point in the second camera's frame minus the point in the first's
  ImageView<const uint8_t> valid;    // nonzero: the pixel has an answer
};

struct TrueSceneFlow {
  MotionField motion;
  ImageView<const float> depth_m;   // of the first frame, 0 = unknown
  ImageView<const uint8_t> hidden;  // nonzero: hidden or outside in the second frame; empty: not known
};

// Hidden pixels are those of the true `hidden`; where that is not known, all count as visible.
enum class MotionRegion { kAll, kVisible, kHidden, kNearJumps, kMoving };
inline constexpr std::array kMotionRegions = {MotionRegion::kAll, MotionRegion::kVisible, MotionRegion::kHidden,
                                              MotionRegion::kNearJumps, MotionRegion::kMoving};
// "all", "visible", "hidden", "near_jumps", "moving".
std::string_view MotionRegionName(MotionRegion region);

struct SceneFlowScore {
  int64_t pixels = 0;
  double epe3d_m = 0.0;         // mean |S^ - S|
  double rmse_v_m = 0.0;        // sqrt(mean |S^ - S|^2)
  double median3d_m = 0.0;      // of |S^ - S|, to within 0.1 %
  double epe2d_px = 0.0;        // mean |(u^, v^) - (u, v)|
  double aae_flow_deg = 0.0;    // mean angle between (u^, v^, 1) and (u, v, 1), pixels
  double aae_motion_deg = 0.0;  // mean angle between (S^, 1) and (S, 1), metres
  // Shares of pixels, [0,1]. Relative errors are to |S|.
  double accurate_strict = 0.0;   // |S^ - S| below 5 cm or 5 %
  double accurate_relaxed = 0.0;  // below 10 cm or 10 %
  double outliers = 0.0;          // above 30 cm, or above 1 cm and 10 %: 10 % of a motion of millimetres is no outlier
};

class SceneFlowErrors {
 public:
  // One pixel, all finite.
  void Add(const Float3& motion_m, const Flow2& flow_px, const Float3& true_motion_m, const Flow2& true_flow_px);
  SceneFlowScore Score() const;

 private:
  LogHistogram magnitudes_;
  double sum_m_ = 0.0, sum_squares_m2_ = 0.0, sum_px_ = 0.0, sum_flow_deg_ = 0.0, sum_motion_deg_ = 0.0;
  int64_t strict_ = 0, relaxed_ = 0, outliers_ = 0;
};

// Several methods on the same pairs of frames, scored on the pixels that all of them answer.
class SceneFlowComparison {
 public:
  struct MethodScore {
    std::string name;
    double completeness = 0.0;                                    // share of pixels with truth that it answers
    std::array<SceneFlowScore, kMotionRegions.size()> by_region;  // in the order of kMotionRegions
    const SceneFlowScore& operator[](MotionRegion region) const { return by_region[static_cast<size_t>(region)]; }
  };

  explicit SceneFlowComparison(std::vector<std::string> names);

  // One pair; `estimates` in the order of the names. Scored are pixels of known true motion and of known depth nearer
  // than `farthest_m`; moving are those that truly move by more than kMovingPx, near jumps those of EdgeBand(depth).
  void Add(const TrueSceneFlow& truth, std::span<const MotionField> estimates, float farthest_m);
  std::vector<MethodScore> Scores() const;

 private:
  struct Method {
    std::string name;
    int64_t answered = 0;
    std::array<SceneFlowErrors, kMotionRegions.size()> errors;
  };
  std::vector<Method> methods_;
  int64_t with_truth_ = 0;
};

// Where there is no true motion but depth of both frames: the points of the first frame, moved, are drawn into the
// second (nearest pixel, nearest point wins) and compared with what was measured there.
struct TransferScore {
  std::string name;
  int64_t pixels = 0;           // those that all methods draw on and both frames know
  double depth_error = 0.0;     // mean |z^ - z| / z, each at most kMostTransferError: beyond is occlusion
  double depth_outliers = 0.0;  // share above 5 %
  double color_error = 0.0;     // mean absolute difference of colours, levels
  double coverage = 0.0;        // share of the second frame's known pixels that it draws on
};
inline constexpr double kMostTransferError = 0.25;

std::vector<TransferScore> ScoreTransfer(const RgbdView& from, const RgbdView& to, std::span<const std::string> names,
                                         std::span<const MotionField> estimates);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_METRICS_SCENE_FLOW_ERRORS_H_
