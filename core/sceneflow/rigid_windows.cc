#include "core/sceneflow/rigid_windows.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/sceneflow/color_patch.h"
#include "core/sceneflow/flow_matches.h"
#include "core/sceneflow/rigid_motion.h"
#include "core/sceneflow/surface_windows.h"
#include "core/sceneflow/surfaces.h"

namespace depthtween {
namespace {

constexpr int kRounds = 2;  // the second starts its flow from what the first chose

// Costs, in shares of a full mismatch of colour; kHiddenCost and those of candidates are in surface_windows.h.
constexpr float kHiddenAgainstFlow = 0.40F;  // of being hidden, more, where flow says that it stays in sight
constexpr float kSeesThroughCost = 1.0F;     // of leading in front of the measured depth
constexpr float kSeesThroughAtEdge = 0.3F;
constexpr float kDepthCost = 0.30F, kFlowCost = 0.20F;
constexpr float kFlowScalePx = 2.0F;
constexpr float kSmoothCost = 0.30F, kSmoothScalePx = 1.0F;
constexpr int kSpeckPixels = 40;  // smaller surfaces are specks
// A pixel's own match, shared with no other, must be better by far.
constexpr float kOwnPenalty = 0.25F;

class Estimator {
 public:
  explicit Estimator(const FramePair& pair) : pair_(pair), width_(pair.rays.width()), height_(pair.rays.height()) {}

  absl::StatusOr<SceneFlow> Run() {
    labels_ = LabelSurfaces(pair_.from.depth_m, pair_.noise);
    surface_pixels_.assign(1 + *std::max_element(labels_.data(), labels_.data() + labels_.pixel_count()), 0);
    for (size_t i = 0; i < labels_.pixel_count(); ++i) ++surface_pixels_[labels_.data()[i]];
    from_image_ = ToFloats(pair_.from.color);
    to_image_ = ToFloats(pair_.to.color);
    from_range_ = RangeAround(pair_.from.depth_m);
    to_range_ = RangeAround(pair_.to.depth_m);
    ASSIGN_OR_RETURN(const Image<PointMatch> range_matches, FindRangeMatches(pair_));
    for (int round = 0; round < kRounds; ++round) {
      RETURN_IF_ERROR(pair_.StepDone());
      ASSIGN_OR_RETURN(flow_, FindFlowMatches(pair_, labels_, start_));
      const std::array<const Image<PointMatch>*, 2> proposals = {&range_matches, &flow_.found_again};
      windows_ = FitSurfaceWindows(pair_, labels_, from_image_, to_image_, flow_.matches, proposals);
      RETURN_IF_ERROR(pair_.StepDone());
      Choose();
      for (const int stride : {12, 5, 2, 1}) AskNeighbours(stride);
      if (round + 1 < kRounds) RestartFlow();
    }
    return Answer();
  }

 private:
  // What a pixel says of one motion.
  struct Verdict {
    float cost = std::numeric_limits<float>::max();
    bool hidden = false;
  };

  Verdict Judge(const ColorPatch& patch, int x, int y, const RigidMotion& motion, float limit) const {
    const PointMatch& match = flow_.matches(x, y);
    const Float3 moved = motion * match.point;
    if (!Plausible(pair_, x, y, moved)) return {};
    const Flow2 place = pair_.to_rays.Project(moved);
    const Verdict hidden = {kHiddenCost + kHiddenAgainstFlow * match.flow_weight * match.information.Mean(), true};
    if (!pair_.to_rays.Inside(place)) return hidden;
    const int nx = std::clamp(static_cast<int>(std::lround(place.u)), 0, width_ - 1);
    const int ny = std::clamp(static_cast<int>(std::lround(place.v)), 0, height_ - 1);
    // Silhouettes are measured to a pixel, and grazed surfaces are rough: what a neighbour was measured at, there or
    // here, will do.
    const DepthRange here = from_range_(x, y), around = to_range_(nx, ny);
    const float z = match.point.z, nearest = moved.z + here.near_m - z, farthest = moved.z + here.far_m - z;
    const bool behind = nearest > around.far_m && !SameLayer(nearest, around.far_m, pair_.noise);
    const bool before = farthest < around.near_m && !SameLayer(farthest, around.near_m, pair_.noise);
    const float trust = 1.0F / ((1.0F + pair_.to.distance(nx, ny)) * (1.0F + pair_.from.distance(x, y)));
    // The depth of a speck is noise or a mixture.
    const bool speck = surface_pixels_[labels_(x, y)] < kSpeckPixels;
    if (behind && !speck) return hidden;
    float cost = 0.0F;
    if (before && !speck) cost += (flow_.smeared(x, y) != 0 ? kSeesThroughAtEdge : kSeesThroughCost) * trust;
    const float there = SampleSurface(pair_.to.depth_m, place.u, place.v, pair_.noise);
    const float off = (moved.z - there) / (3.0F * (pair_.noise.At(there) + kModelShare * there));
    cost += DepthChangeCost(std::abs(moved.z - match.point.z) / match.point.z);
    if (!speck && !before && SameLayer(moved.z, there, pair_.noise))
      cost += kDepthCost * trust * std::min(off * off, 1.0F);
    const float du = place.u - match.place.u, dv = place.v - match.place.v;
    cost += kFlowCost * match.flow_weight *
            std::min(match.information.Quadratic(du, dv) / (kFlowScalePx * kFlowScalePx), 1.0F);
    if (cost >= limit) return {cost, false};
    cost += patch.CostAt(to_image_, place.u, place.v);
    return {cost, false};
  }

  // What a pixel and its eight neighbours were measured at.
  struct DepthRange {
    float near_m = 0.0F, far_m = 0.0F;
  };
  Image<DepthRange> RangeAround(ImageView<const float> depth_m) const {
    Image<DepthRange> ranges(width_, height_);
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) {
          DepthRange range{depth_m(x, y), depth_m(x, y)};
          for (int i = 0; i < 9; ++i) {
            const float z = depth_m.Clamped(x + i % 3 - 1, y + i / 3 - 1);
            range = {std::min(range.near_m, z), std::max(range.far_m, z)};
          }
          ranges(x, y) = range;
        }
    });
    return ranges;
  }

  struct Choice {
    RigidMotion motion;
    float cost = std::numeric_limits<float>::max();  // with penalty
    float penalty = 0.0F;
    bool hidden = false;
  };

  void Choose() {
    choices_ = Image<Choice>(width_, height_);
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) choices_(x, y) = ChooseAt(x, y);
    });
  }

  Choice ChooseAt(int x, int y) const {
    const ColorPatch patch(from_image_, labels_, x, y);
    Choice best{.cost = kWorstCost, .hidden = true};
    const auto propose = [&](const RigidMotion& motion, float penalty, bool seen_only = false) {
      const Verdict verdict = Judge(patch, x, y, motion, best.cost - penalty);
      if (seen_only && verdict.hidden) return;
      if (verdict.cost + penalty < best.cost) best = {motion, verdict.cost + penalty, penalty, verdict.hidden};
    };
    if (surface_pixels_[labels_(x, y)] < kSpeckPixels)
      for (const RigidMotion& motion : windows_.dominant) propose(motion, 0.0F);
    // Those of the nearest window on its surface; a speck without one belongs to one of the surfaces around it.
    const Window* nearest = nullptr;
    windows_.small.ForNeighbours(x, y, [&](const Window& window) {
      const auto far = [&](const Window& w) {
        return (w.label == labels_(x, y) ? 0 : 1000) + std::abs(w.x - x) + std::abs(w.y - y);
      };
      if (nearest == nullptr || far(window) < far(*nearest)) nearest = &window;
    });
    if (nearest != nullptr)
      for (const Window::Candidate& candidate : nearest->candidates)
        propose(candidate.motion, candidate.penalty, candidate.seen_only);
    const PointMatch& own = flow_.matches(x, y);
    if (own.flow_weight > 0.0F)
      propose(RigidMotion::Translation(FoundPoint(pair_, own) - own.point),
              kOwnPenalty + kWindowShare * windows_.alone_cost[labels_(x, y)]);
    return best;
  }

  void AskNeighbours(int stride) {
    const std::array<std::pair<int, int>, 8> asked = {{{-stride, 0},
                                                       {stride, 0},
                                                       {0, -stride},
                                                       {0, stride},
                                                       {-stride, -stride},
                                                       {stride, stride},
                                                       {stride, -stride},
                                                       {-stride, stride}}};
    Image<Choice> next = choices_.Clone();
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) {
          std::array<const Choice*, 8> neighbours = {};
          size_t count = 0;
          const Choice& own = choices_(x, y);
          bool news = false;
          for (const auto& [dx, dy] : asked)
            if (choices_.Contains(x + dx, y + dy) && labels_(x + dx, y + dy) == labels_(x, y)) {
              neighbours[count++] = &choices_(x + dx, y + dy);
              news = news || !(neighbours[count - 1]->motion == own.motion);
            }
          if (!news) continue;
          const Float3 point = flow_.matches(x, y).point;
          std::array<Flow2, 8> places;
          for (size_t i = 0; i < count; ++i) places[i] = pair_.to_rays.Project(neighbours[i]->motion * point);
          const auto rough = [&](const Flow2& place) {
            float sum = 0.0F;
            for (size_t i = 0; i < count; ++i) {
              const float du = place.u - places[i].u, dv = place.v - places[i].v;
              sum += std::min((du * du + dv * dv) / (kSmoothScalePx * kSmoothScalePx), 1.0F);
            }
            return kSmoothCost * sum / static_cast<float>(count);
          };
          const ColorPatch patch(from_image_, labels_, x, y);
          Choice best = own;
          float best_cost = own.cost + rough(pair_.to_rays.Project(own.motion * point));
          for (size_t i = 0; i < count; ++i) {
            const auto known = [&](const Choice* other) { return other->motion == neighbours[i]->motion; };
            if (known(&own) || std::any_of(neighbours.begin(), neighbours.begin() + i, known)) continue;
            const float extra = neighbours[i]->penalty + rough(places[i]);
            if (extra >= best_cost) continue;
            const Verdict verdict = Judge(patch, x, y, neighbours[i]->motion, best_cost - extra);
            if (verdict.cost + extra >= best_cost) continue;
            best_cost = verdict.cost + extra;
            best = {neighbours[i]->motion, verdict.cost + neighbours[i]->penalty, neighbours[i]->penalty,
                    verdict.hidden};
          }
          next(x, y) = best;
        }
    });
    choices_ = std::move(next);
  }

  // Whether something nearer was measured where a point goes, or it leaves the picture.
  bool Hides(const Float3& moved) const {
    const Flow2 place = pair_.to_rays.Project(moved);
    if (!pair_.to_rays.Inside(place)) return true;
    const float there = SampleSurface(pair_.to.depth_m, place.u, place.v, pair_.noise);
    return moved.z > there && !SameLayer(moved.z, there, pair_.noise);
  }

  // Averages what neighbours on the same surface say of this pixel's point, if they agree with its own choice.
  SceneFlow Answer() const {
    constexpr int kReach = 6, kStep = 2;
    constexpr float kAgreePx = 0.7F;
    SceneFlow out = EmptySceneFlow(width_, height_);
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) {
          const Choice& own = choices_(x, y);
          const Float3 point = flow_.matches(x, y).point;
          const Float3 moved = own.motion * point;
          const float px_per_m = pair_.rays.focal_px() / std::max(moved.z, 1e-3F);
          Float3 sum = moved;
          float weights = 1.0F;
          for (int dy = -kReach; dy <= kReach; dy += kStep)
            for (int dx = -kReach; dx <= kReach; dx += kStep) {
              if ((dx == 0 && dy == 0) || !labels_.Contains(x + dx, y + dy) || labels_(x + dx, y + dy) != labels_(x, y))
                continue;
              const Float3 other = choices_(x + dx, y + dy).motion * point;
              const Float3 off = px_per_m * (other - moved);
              const float squared = off.x * off.x + off.y * off.y + off.z * off.z;
              if (squared > 4 * kAgreePx * kAgreePx) continue;
              const float weight = std::exp(-squared / (kAgreePx * kAgreePx));
              sum = sum + weight * other;
              weights += weight;
            }
          const Float3 answer = (1.0F / weights) * sum;
          SetMotion(pair_, x, y, answer, out);
          const bool hidden = Hides(answer);
          out.hidden(x, y) = hidden ? 1 : 0;
          const float certain = hidden ? kHiddenConfidence : std::exp(-3.0F * std::max(own.cost, 0.0F));
          out.confidence(x, y) = std::max(certain / (1.0F + 0.1F * pair_.from.distance(x, y)), kLeastConfidence);
        }
    });
    return out;
  }

  // The chosen motions, as flow both ways: backward flow where a chosen motion arrives, nearest first; elsewhere
  // unchanged.
  void RestartFlow() {
    Image<float> nearest(width_, height_);
    start_[0] = Image<Flow2>(width_, height_);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const Float3 moved = choices_(x, y).motion * flow_.matches(x, y).point;
        const Flow2 place = pair_.to_rays.Project(moved);
        const Flow2 flow = {place.u - static_cast<float>(x), place.v - static_cast<float>(y)};
        if (!pair_.to_rays.Inside(place)) {
          start_[0](x, y) = {flow_.matches(x, y).place.u - static_cast<float>(x),
                             flow_.matches(x, y).place.v - static_cast<float>(y)};
          continue;
        }
        start_[0](x, y) = flow;
        const int px = std::clamp(static_cast<int>(std::lround(place.u)), 0, width_ - 1);
        const int py = std::clamp(static_cast<int>(std::lround(place.v)), 0, height_ - 1);
        float& z = nearest(px, py);
        if (choices_(x, y).hidden || (z > 0.0F && z <= moved.z)) continue;
        z = moved.z;
        start_[1](px, py) = {-flow.u, -flow.v};
      }
  }

  static constexpr float kWorstCost = 4.0F;  // more than any verdict
  static constexpr float kHiddenConfidence = 0.2F, kLeastConfidence = 0.01F;

  const FramePair& pair_;
  const int width_, height_;
  Image<int> labels_;
  std::vector<int> surface_pixels_;  // by surface
  Image<Color4> from_image_, to_image_;
  Image<DepthRange> from_range_, to_range_;
  std::array<Image<Flow2>, 2> start_;  // of the flow, forward and backward; empty in the first round
  FlowMatches flow_;
  SurfaceWindows windows_;
  Image<Choice> choices_;
};

}  // namespace

absl::StatusOr<SceneFlow> RigidWindowsFlow(const FramePair& pair) { return Estimator(pair).Run(); }

}  // namespace depthtween
