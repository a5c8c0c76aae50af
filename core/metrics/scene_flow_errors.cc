#include "core/metrics/scene_flow_errors.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "core/metrics/regions.h"

namespace depthtween {
namespace {

constexpr double kStrictM = 0.05, kStrictShare = 0.05;
constexpr double kRelaxedM = 0.10, kRelaxedShare = 0.10;
constexpr double kOutlierM = 0.30, kOutlierShare = 0.10, kLeastOutlierM = 0.01;
constexpr double kTransferOutlier = 0.05;
constexpr double kDegrees = 57.29577951308232;

double Ratio(double part, double whole) { return whole > 0.0 ? part / whole : 0.0; }

double Norm(const Float3& v) { return std::sqrt(double{v.x} * v.x + double{v.y} * v.y + double{v.z} * v.z); }

// From the cross and the dot product: the arc cosine alone loses small angles to rounding.
double Angle(double cross, double dot) { return kDegrees * std::atan2(cross, dot); }

double FlowAngle(const Flow2& a, const Flow2& b) {
  const double du = double{a.u} - b.u, dv = double{a.v} - b.v, turn = double{a.u} * b.v - double{a.v} * b.u;
  return Angle(std::sqrt(du * du + dv * dv + turn * turn), double{a.u} * b.u + double{a.v} * b.v + 1.0);
}

double MotionAngle(const Float3& a, const Float3& b) {
  const double dx = double{a.x} - b.x, dy = double{a.y} - b.y, dz = double{a.z} - b.z;
  const double xy = double{a.x} * b.y - double{a.y} * b.x, xz = double{a.x} * b.z - double{a.z} * b.x,
               yz = double{a.y} * b.z - double{a.z} * b.y;
  return Angle(std::sqrt(dx * dx + dy * dy + dz * dz + xy * xy + xz * xz + yz * yz),
               double{a.x} * b.x + double{a.y} * b.y + double{a.z} * b.z + 1.0);
}

bool AnsweredByAll(std::span<const MotionField> estimates, int x, int y) {
  return std::all_of(estimates.begin(), estimates.end(), [&](const MotionField& e) { return e.valid(x, y) != 0; });
}

// The second frame as a method predicts it; depth 0 where it draws nothing.
struct Prediction {
  Image<float> depth_m;
  Image<Rgb8> color;
};

Prediction Draw(const RgbdView& from, const MotionField& motion) {
  Prediction drawn{Image<float>(from.depth_m.width(), from.depth_m.height()),
                   Image<Rgb8>(from.depth_m.width(), from.depth_m.height())};
  for (int y = 0; y < from.depth_m.height(); ++y)
    for (int x = 0; x < from.depth_m.width(); ++x) {
      if (motion.valid(x, y) == 0 || !(from.depth_m(x, y) > 0.0F)) continue;
      const Flow2 flow = motion.flow_px(x, y);
      const int tx = static_cast<int>(std::lround(static_cast<float>(x) + flow.u));
      const int ty = static_cast<int>(std::lround(static_cast<float>(y) + flow.v));
      const float z = from.depth_m(x, y) + motion.motion_m(x, y).z;
      if (!drawn.depth_m.Contains(tx, ty) || !(z > 0.0F)) continue;
      float& nearest = drawn.depth_m(tx, ty);
      if (nearest > 0.0F && nearest <= z) continue;
      nearest = z;
      drawn.color(tx, ty) = from.color(x, y);
    }
  return drawn;
}

}  // namespace

std::string_view MotionRegionName(MotionRegion region) {
  switch (region) {
    case MotionRegion::kAll:
      return "all";
    case MotionRegion::kVisible:
      return "visible";
    case MotionRegion::kHidden:
      return "hidden";
    case MotionRegion::kNearJumps:
      return "near_jumps";
    case MotionRegion::kMoving:
      return "moving";
  }
  return "";
}

void SceneFlowErrors::Add(const Float3& motion_m, const Flow2& flow_px, const Float3& true_motion_m,
                          const Flow2& true_flow_px) {
  const double error_m =
      Norm({motion_m.x - true_motion_m.x, motion_m.y - true_motion_m.y, motion_m.z - true_motion_m.z});
  const double length_m = Norm(true_motion_m);
  magnitudes_.Add(static_cast<float>(error_m), 0.0);
  sum_m_ += error_m;
  sum_squares_m2_ += error_m * error_m;
  sum_px_ += std::hypot(double{flow_px.u} - true_flow_px.u, double{flow_px.v} - true_flow_px.v);
  sum_flow_deg_ += FlowAngle(flow_px, true_flow_px);
  sum_motion_deg_ += MotionAngle(motion_m, true_motion_m);
  if (error_m < kStrictM || error_m < kStrictShare * length_m) ++strict_;
  if (error_m < kRelaxedM || error_m < kRelaxedShare * length_m) ++relaxed_;
  if (error_m > kOutlierM || (error_m > kLeastOutlierM && error_m > kOutlierShare * length_m)) ++outliers_;
}

SceneFlowScore SceneFlowErrors::Score() const {
  const auto count = static_cast<double>(magnitudes_.count());
  return {.pixels = magnitudes_.count(),
          .epe3d_m = Ratio(sum_m_, count),
          .rmse_v_m = std::sqrt(Ratio(sum_squares_m2_, count)),
          .median3d_m = magnitudes_.Quantile(0.5),
          .epe2d_px = Ratio(sum_px_, count),
          .aae_flow_deg = Ratio(sum_flow_deg_, count),
          .aae_motion_deg = Ratio(sum_motion_deg_, count),
          .accurate_strict = Ratio(static_cast<double>(strict_), count),
          .accurate_relaxed = Ratio(static_cast<double>(relaxed_), count),
          .outliers = Ratio(static_cast<double>(outliers_), count)};
}

SceneFlowComparison::SceneFlowComparison(std::vector<std::string> names) {
  for (std::string& name : names) methods_.push_back({.name = std::move(name)});
}

void SceneFlowComparison::Add(const TrueSceneFlow& truth, std::span<const MotionField> estimates, float farthest_m) {
  assert(estimates.size() == methods_.size());
  const Image<uint8_t> near_jumps = EdgeBand(truth.depth_m);
  for (int y = 0; y < truth.depth_m.height(); ++y)
    for (int x = 0; x < truth.depth_m.width(); ++x) {
      const float z = truth.depth_m(x, y);
      if (truth.motion.valid(x, y) == 0 || !(z > 0.0F && z < farthest_m)) continue;
      ++with_truth_;
      for (size_t m = 0; m < methods_.size(); ++m) methods_[m].answered += estimates[m].valid(x, y) != 0 ? 1 : 0;
      if (!AnsweredByAll(estimates, x, y)) continue;
      const Flow2 flow = truth.motion.flow_px(x, y);
      const Float3 motion = truth.motion.motion_m(x, y);
      const bool hidden = !truth.hidden.empty() && truth.hidden(x, y) != 0;
      const std::array<bool, kMotionRegions.size()> inside = {true, !hidden, hidden, near_jumps(x, y) != 0,
                                                              std::hypot(flow.u, flow.v) > kMovingPx};
      for (size_t m = 0; m < methods_.size(); ++m)
        for (size_t r = 0; r < inside.size(); ++r)
          if (inside[r])
            methods_[m].errors[r].Add(estimates[m].motion_m(x, y), estimates[m].flow_px(x, y), motion, flow);
    }
}

std::vector<SceneFlowComparison::MethodScore> SceneFlowComparison::Scores() const {
  std::vector<MethodScore> scores;
  for (const Method& method : methods_) {
    MethodScore& score = scores.emplace_back();
    score.name = method.name;
    score.completeness = Ratio(static_cast<double>(method.answered), static_cast<double>(with_truth_));
    for (size_t r = 0; r < score.by_region.size(); ++r) score.by_region[r] = method.errors[r].Score();
  }
  return scores;
}

std::vector<TransferScore> ScoreTransfer(const RgbdView& from, const RgbdView& to, std::span<const std::string> names,
                                         std::span<const MotionField> estimates) {
  assert(names.size() == estimates.size());
  std::vector<Prediction> drawn;
  std::vector<TransferScore> scores;
  for (size_t m = 0; m < estimates.size(); ++m) {
    drawn.push_back(Draw(from, estimates[m]));
    scores.push_back({.name = names[m]});
  }
  int64_t known = 0;
  for (int y = 0; y < to.depth_m.height(); ++y)
    for (int x = 0; x < to.depth_m.width(); ++x) {
      const float z = to.depth_m(x, y);
      if (!(z > 0.0F)) continue;
      ++known;
      bool all = true;
      for (size_t m = 0; m < drawn.size(); ++m) {
        const bool here = drawn[m].depth_m(x, y) > 0.0F;
        scores[m].coverage += here ? 1.0 : 0.0;
        all = all && here;
      }
      if (!all) continue;
      const Rgb8 seen = to.color(x, y);
      for (size_t m = 0; m < drawn.size(); ++m) {
        const double error = std::abs(double{drawn[m].depth_m(x, y)} - z) / z;
        const Rgb8 carried = drawn[m].color(x, y);
        ++scores[m].pixels;
        scores[m].depth_error += std::min(error, kMostTransferError);
        scores[m].depth_outliers += error > kTransferOutlier ? 1.0 : 0.0;
        scores[m].color_error +=
            (std::abs(carried.r - seen.r) + std::abs(carried.g - seen.g) + std::abs(carried.b - seen.b)) / 3.0;
      }
    }
  for (TransferScore& score : scores) {
    const auto pixels = static_cast<double>(score.pixels);
    score.depth_error = Ratio(score.depth_error, pixels);
    score.depth_outliers = Ratio(score.depth_outliers, pixels);
    score.color_error = Ratio(score.color_error, pixels);
    score.coverage = Ratio(score.coverage, static_cast<double>(known));
  }
  return scores;
}

}  // namespace depthtween
