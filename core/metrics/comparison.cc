#include "core/metrics/comparison.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

bool Known(float depth_m) { return depth_m > 0.0F && std::isfinite(depth_m); }

template <typename T, typename U>
bool FitsOrEmpty(ImageView<T> image, ImageView<U> truth) {
  return image.empty() || image.SameSize(truth);
}

template <typename T>
Image<T> Copy(ImageView<const T> view) {
  Image<T> copy(view.width(), view.height());
  for (int y = 0; y < view.height(); ++y) std::copy_n(view.row(y), view.width(), copy.row(y));
  return copy;
}

}  // namespace

Comparison::Comparison(std::vector<std::string> method_names, float far_m) : far_m_(far_m) {
  for (std::string& name : method_names) {
    methods_.emplace_back();
    methods_.back().name = std::move(name);
  }
}

absl::Status Comparison::AddFrame(const TruthFrame& truth, std::span<const MethodFrame> methods) {
  const int width = truth.depth_m.width(), height = truth.depth_m.height();
  if (methods.size() != methods_.size())
    return absl::InvalidArgumentError(
        absl::StrFormat("%d estimates for %d methods, must be one each", methods.size(), methods_.size()));
  for (size_t m = 0; m < methods.size(); ++m) {
    const ImageView<const float> depth_m = methods[m].depth_m;
    if (!depth_m.SameSize(truth.depth_m) || !FitsOrEmpty(methods[m].sigma_m, truth.depth_m))
      return absl::InvalidArgumentError(
          absl::StrFormat("%s is %d x %d, the truth %d x %d, must be the same: was the result made from this sequence?",
                          methods_[m].name, depth_m.width(), depth_m.height(), width, height));
  }
  const TrueMotion& motion = truth.motion;
  if (!FitsOrEmpty(motion.flow_px, truth.depth_m) || !motion.flow_px.SameSize(motion.valid) ||
      !FitsOrEmpty(motion.hidden_in_next, truth.depth_m) || !FitsOrEmpty(truth.unseen, truth.depth_m) ||
      !FitsOrEmpty(truth.color, truth.depth_m))
    return absl::InvalidArgumentError(
        absl::StrFormat("true flow, occlusion, colour and depth of colour frame %d differ in size, must be %d x %d",
                        truth.color_index, width, height));

  const Image<uint8_t> edge_band = EdgeBand(truth.depth_m);
  const Image<uint8_t> untextured = truth.color.empty() ? Image<uint8_t>() : Untextured(truth.color);
  Image<float> truth_m(width, height);  // where all methods answer, else 0
  std::vector<Image<float>> estimates_m;
  for (size_t m = 0; m < methods.size(); ++m) estimates_m.emplace_back(width, height);
  std::vector<double> sum_squares_m2(methods.size(), 0.0);
  FrameScore frame{.color_index = truth.color_index};

  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float true_m = truth.depth_m(x, y);
      if (!Known(true_m) || true_m >= far_m_) continue;
      ++truth_pixels_;
      bool common = true;
      for (size_t m = 0; m < methods.size(); ++m) {
        const bool filled = Known(methods[m].depth_m(x, y));
        methods_[m].filled += filled ? 1 : 0;
        common = common && filled;
      }
      if (!common) continue;
      ++frame.pixels;
      truth_m(x, y) = true_m;
      const bool moves_known = !motion.flow_px.empty() && motion.valid(x, y) != 0;
      const float motion_px = moves_known ? std::hypot(motion.flow_px(x, y).u, motion.flow_px(x, y).v) : 0.0F;
      const bool unseen = !truth.unseen.empty() && truth.unseen(x, y) != 0;
      for (size_t m = 0; m < methods.size(); ++m) {
        const float estimate_m = methods[m].depth_m(x, y);
        const float error_m = estimate_m - true_m;
        estimates_m[m](x, y) = estimate_m;
        sum_squares_m2[m] += static_cast<double>(error_m) * error_m;
        const auto add = [&](Region region) { methods_[m].errors[static_cast<size_t>(region)].Add(error_m); };
        add(Region::kAll);
        add(edge_band(x, y) != 0 ? Region::kEdgeBand : Region::kInterior);
        if (moves_known) add(motion_px > kMovingPx ? Region::kMoving : Region::kStatic);
        if (motion_px > kFastPx) add(Region::kFast);
        if (unseen) add(Region::kDisoccluded);
        if (!untextured.empty() && untextured(x, y) != 0) add(Region::kUntextured);
        if (methods[m].sigma_m.empty()) continue;
        if (const float sigma_m = methods[m].sigma_m(x, y); Known(sigma_m))
          methods_[m].uncertainty.Add(error_m, sigma_m);
      }
    }
  }

  for (size_t m = 0; m < methods.size(); ++m) {
    methods_[m].edges.Add(truth_m, estimates_m[m]);
    frame.rmse_mm.push_back(frame.pixels > 0 ? 1000.0 * std::sqrt(sum_squares_m2[m] / static_cast<double>(frame.pixels))
                                             : 0.0);
  }
  common_pixels_ += frame.pixels;
  frames_.push_back(std::move(frame));

  if (previous_index_ >= 0 && previous_index_ + 1 == truth.color_index && !previous_flow_px_.empty())
    AddFlicker(truth_m, estimates_m);
  previous_index_ = truth.color_index;
  previous_truth_m_ = std::move(truth_m);
  for (size_t m = 0; m < methods.size(); ++m) methods_[m].previous_m = std::move(estimates_m[m]);
  previous_flow_px_ = Copy(motion.flow_px);
  previous_followed_ = Copy(motion.valid);
  if (!motion.hidden_in_next.empty() && !previous_followed_.empty())
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        if (motion.hidden_in_next(x, y) != 0) previous_followed_(x, y) = 0;
  return absl::OkStatus();
}

void Comparison::AddFlicker(const Image<float>& truth_m, const std::vector<Image<float>>& estimates_m) {
  for (int y = 0; y < truth_m.height(); ++y) {
    for (int x = 0; x < truth_m.width(); ++x) {
      if (previous_followed_(x, y) == 0 || previous_truth_m_(x, y) == 0.0F) continue;
      const Flow2 flow = previous_flow_px_(x, y);
      // The nearest pixel: interpolation would mix both sides of an edge into a change of its own.
      const int nx = static_cast<int>(std::lround(static_cast<float>(x) + flow.u));
      const int ny = static_cast<int>(std::lround(static_cast<float>(y) + flow.v));
      if (!truth_m.Contains(nx, ny) || truth_m(nx, ny) == 0.0F) continue;
      ++flicker_pixels_;
      const float true_change_m = truth_m(nx, ny) - previous_truth_m_(x, y);
      for (size_t m = 0; m < methods_.size(); ++m) {
        const float change_m = estimates_m[m](nx, ny) - methods_[m].previous_m(x, y);
        methods_[m].flicker_sum_m += std::abs(change_m - true_change_m);
      }
    }
  }
}

ComparisonScore Comparison::Score() const {
  ComparisonScore score{.truth_pixels = truth_pixels_, .frames = frames_};
  score.common_pixels = common_pixels_;
  for (const Method& method : methods_) {
    MethodScore& out = score.methods.emplace_back();
    out.name = method.name;
    for (size_t r = 0; r < kRegions.size(); ++r) out.regions[r] = method.errors[r].Score();
    out.errors_below = method.errors[static_cast<size_t>(Region::kAll)].Curve();
    out.edges = method.edges.Score();
    out.completeness =
        truth_pixels_ > 0 ? static_cast<double>(method.filled) / static_cast<double>(truth_pixels_) : 0.0;
    if (flicker_pixels_ > 0) out.flicker_mm = 1000.0 * method.flicker_sum_m / static_cast<double>(flicker_pixels_);
    out.uncertainty = method.uncertainty.Score();
  }
  return score;
}

}  // namespace depthtween
