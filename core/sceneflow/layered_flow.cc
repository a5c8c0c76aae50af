#include "core/sceneflow/layered_flow.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/flow/dense_flow.h"
#include "core/sceneflow/pyramid.h"
#include "core/sceneflow/range_flow.h"
#include "core/sceneflow/rigid_motion.h"

namespace depthtween {
namespace {

constexpr int kLayers = 5;
constexpr int kClusterRounds = 20, kVoteRadius = 2, kOuterRounds = 2;
constexpr int kFitEvery = 2;  // pixels

class Estimator {
 public:
  explicit Estimator(const FramePair& pair)
      : pair_(pair), width_(pair.rays.width()), height_(pair.rays.height()), layer_(width_, height_) {
    auto finest = BuildPyramid(pair, std::max(width_, height_));  // one level
    level_ = std::move(finest.front());
  }

  absl::StatusOr<SceneFlow> Run() {
    ASSIGN_OR_RETURN(flow_, DenseFlow(pair_.from.luma, pair_.to.luma, {}));
    CutByDepth();
    Vote();
    hidden_ = Image<uint8_t>(width_, height_);
    for (int round = 0; round < kOuterRounds; ++round) {
      RETURN_IF_ERROR(pair_.StepDone());
      FitLayers();
      if (round > 0) Reassign();
      Refine();
      FindHidden();
    }
    return Answer();
  }

 private:
  // K-means of inverse depth; layers in ascending order of depth.
  void CutByDepth() {
    const Image<float>& depth = pair_.from.depth_m;
    std::vector<float> inverse;
    for (size_t i = 0; i < depth.pixel_count(); i += 7) inverse.push_back(1.0F / depth.data()[i]);
    std::sort(inverse.begin(), inverse.end(), std::greater<>());
    for (int l = 0; l < kLayers; ++l) {
      centre_[l] = inverse[(2 * l + 1) * inverse.size() / (2 * kLayers)];
    }
    for (int round = 0; round < kClusterRounds; ++round) {
      std::array<double, kLayers> sum = {}, count = {};
      for (const float value : inverse) {
        const int l = NearestLayer(value);
        sum[l] += value;
        count[l] += 1;
      }
      for (int l = 0; l < kLayers; ++l)
        if (count[l] > 0) centre_[l] = static_cast<float>(sum[l] / count[l]);
    }
    for (size_t i = 0; i < depth.pixel_count(); ++i) layer_.data()[i] = NearestLayer(1.0F / depth.data()[i]);
  }

  int NearestLayer(float inverse_depth) const {
    int best = 0;
    for (int l = 1; l < kLayers; ++l)
      if (std::abs(inverse_depth - centre_[l]) < std::abs(inverse_depth - centre_[best])) best = l;
    return best;
  }

  // Every pixel joins the layer of most of the pixels around it.
  void Vote() {
    Image<int> voted(width_, height_);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        std::array<int, kLayers> votes = {};
        for (int dy = -kVoteRadius; dy <= kVoteRadius; ++dy)
          for (int dx = -kVoteRadius; dx <= kVoteRadius; ++dx)
            if (layer_.Contains(x + dx, y + dy) &&
                SameLayer(pair_.from.depth_m(x, y), pair_.from.depth_m(x + dx, y + dy), pair_.noise))
              ++votes[layer_(x + dx, y + dy)];
        const int own = layer_(x, y);
        const int most = static_cast<int>(std::max_element(votes.begin(), votes.end()) - votes.begin());
        voted(x, y) = votes[most] > votes[own] ? most : own;
      }
    layer_ = std::move(voted);
  }

  void FitLayers() {
    std::array<std::vector<PointMatch>, kLayers> matches;
    for (int y = 0; y < height_; y += kFitEvery)
      for (int x = 0; x < width_; x += kFitEvery) {
        if (hidden_(x, y) != 0) continue;
        const Flow2 flow = flow_(x, y);
        PointMatch match{.point = Point(x, y),
                         .place = {static_cast<float>(x) + flow.u, static_cast<float>(y) + flow.v}};
        if (!pair_.to_rays.Inside(match.place)) continue;
        match.depth_m = SampleSurface(pair_.to.depth_m, match.place.u, match.place.v, pair_.noise);
        match.depth_sigma_m = pair_.noise.At(match.depth_m) + 0.002F * match.depth_m;
        matches[layer_(x, y)].push_back(match);
      }
    ParallelFor(kLayers, pair_.threads, [&](int l) {
      RigidFitOptions options;
      options.iterations = 20;
      // From what it was, and from a few of the layer's own matches.
      std::vector<RigidMotion> starts = {motion_[l]};
      for (size_t i = 0; i < 12 && !matches[l].empty(); ++i) {
        const PointMatch& m = matches[l][(2 * i + 1) * matches[l].size() / 24];
        starts.push_back(RigidMotion::Translation(pair_.to_rays.PointAt(m.place.u, m.place.v, m.depth_m) - m.point));
      }
      RigidFit best;
      for (const RigidMotion& start : starts) {
        const RigidFit fit = Support(pair_.to_rays, matches[l], start, options);
        if (fit.support > best.support) best = fit;
      }
      if (best.support > 0.0F) motion_[l] = FitRigidMotion(pair_.to_rays, matches[l], best.motion, options).motion;
    });
  }

  Float3 Point(int x, int y) const { return pair_.rays.Point(x, y, pair_.from.depth_m(x, y)); }

  // How badly a layer's rigid motion explains a pixel: colour and depth, each at most 1.
  float Mismatch(int layer, int x, int y) const {
    const Float3 moved = motion_[layer] * Point(x, y);
    const Flow2 place = pair_.to_rays.Project(moved);
    if (!pair_.to_rays.Inside(place)) return 1.0F;
    const float light = std::abs(SampleBilinear(level_.to.light, place.u, place.v) - level_.from.light(x, y)) / 0.1F;
    const float there = SampleSurface(pair_.to.depth_m, place.u, place.v, pair_.noise);
    const float range = std::abs(there - moved.z) / (4.0F * pair_.noise.At(there) + 0.01F * there);
    return std::min(light, 1.0F) + std::min(range, 1.0F);
  }

  // To the layer next to its own in depth whose motion explains it better.
  void Reassign() {
    constexpr float kClearly = 0.5F;
    Image<int> next = layer_.Clone();
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) {
          const int own = layer_(x, y);
          float best = Mismatch(own, x, y) - kClearly;
          for (const int other : {own - 1, own + 1}) {
            if (other < 0 || other >= kLayers) continue;
            const float mismatch = Mismatch(other, x, y);
            if (mismatch < best) best = mismatch, next(x, y) = other;
          }
        }
    });
    layer_ = std::move(next);
    Vote();
  }

  // The smooth deviation of each layer from its rigid motion.
  void Refine() {
    RangeField rigid = ZeroRangeField(width_, height_);
    Image<float> trust(width_, height_, 1.0F);
    SurfaceTies ties = TiesAlongSurface(pair_.rays, pair_.from.depth_m);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const Float3 moved = motion_[layer_(x, y)] * Point(x, y);
        const Flow2 place = pair_.to_rays.Project(moved);
        rigid.u(x, y) = place.u - static_cast<float>(x);
        rigid.v(x, y) = place.v - static_cast<float>(y);
        const float z = pair_.from.depth_m(x, y);
        rigid.w(x, y) = (moved.z - z) * pair_.rays.focal_px() / z;
        if (hidden_(x, y) != 0) trust(x, y) = 0.0F;
        if (x + 1 < width_ && layer_(x, y) != layer_(x + 1, y)) ties.right(x, y) = 0.0F;
        if (y + 1 < height_ && layer_(x, y) != layer_(x, y + 1)) ties.below(x, y) = 0.0F;
      }
    // Where the rigid motion is far off the flow starts better.
    field_ = {rigid.u.Clone(), rigid.v.Clone(), rigid.w.Clone()};
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const Flow2 flow = flow_(x, y);
        if (hidden_(x, y) != 0 || std::hypot(flow.u - rigid.u(x, y), flow.v - rigid.v(x, y)) < 1.0F) continue;
        const float there = SampleSurface(pair_.to.depth_m, static_cast<float>(x) + flow.u,
                                          static_cast<float>(y) + flow.v, pair_.noise);
        const float z = pair_.from.depth_m(x, y);
        field_.u(x, y) = flow.u;
        field_.v(x, y) = flow.v;
        field_.w(x, y) = (there - z) * pair_.rays.focal_px() / z;
      }
    SolveRangeFlow(level_, ties, trust, rigid, pair_.noise, {.warps = 4}, pair_.threads, field_);
  }

  Float3 Moved(int x, int y) const {
    const float z = pair_.from.depth_m(x, y);
    const float moved_z = std::max(z + field_.w(x, y) * z / pair_.rays.focal_px(), kNearestMovedShare * z);
    return pair_.to_rays.PointAt(static_cast<float>(x) + field_.u(x, y), static_cast<float>(y) + field_.v(x, y),
                                 moved_z);
  }

  // Pixels that a nearer layer, or nearer measured depth, occludes in the second frame.
  void FindHidden() {
    Image<float> nearest(width_, height_);
    const auto place_of = [&](int x, int y) {
      return std::pair{static_cast<int>(std::lround(static_cast<float>(x) + field_.u(x, y))),
                       static_cast<int>(std::lround(static_cast<float>(y) + field_.v(x, y)))};
    };
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const auto [px, py] = place_of(x, y);
        if (!nearest.Contains(px, py)) continue;
        float& z = nearest(px, py);
        const float moved = Moved(x, y).z;
        if (z == 0.0F || moved < z) z = moved;
      }
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const auto [px, py] = place_of(x, y);
        if (!nearest.Contains(px, py)) {
          hidden_(x, y) = 1;
          continue;
        }
        const float z = Moved(x, y).z;
        const auto covered_by = [&](float other) { return other < z && !SameLayer(other, z, pair_.noise); };
        hidden_(x, y) = covered_by(nearest(px, py)) || covered_by(pair_.to.depth_m(px, py)) ? 1 : 0;
      }
  }

  SceneFlow Answer() const {
    SceneFlow out = EmptySceneFlow(width_, height_);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        SetMotion(pair_, x, y, Moved(x, y), out);
        out.hidden(x, y) = hidden_(x, y);
        out.confidence(x, y) = hidden_(x, y) != 0 ? 0.5F : 1.0F;
      }
    return out;
  }

  const FramePair& pair_;
  const int width_, height_;
  PyramidLevel level_;
  Image<Flow2> flow_;
  Image<int> layer_;
  std::array<float, kLayers> centre_ = {};  // inverse depth, descending
  std::array<RigidMotion, kLayers> motion_;
  Image<uint8_t> hidden_;
  RangeField field_;
};

}  // namespace

absl::StatusOr<SceneFlow> LayeredFlow(const FramePair& pair) { return Estimator(pair).Run(); }

}  // namespace depthtween
