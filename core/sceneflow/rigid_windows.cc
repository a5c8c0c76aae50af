#include "core/sceneflow/rigid_windows.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/flow/dense_flow.h"
#include "core/sceneflow/color_patch.h"
#include "core/sceneflow/rigid_motion.h"
#include "core/sceneflow/surfaces.h"

namespace depthtween {
namespace {

// Flow that returns within this many pixels of its start is trusted.
constexpr float kRoundTripPx = 1.0F, kRoundTripPerPx = 0.02F;
// Flow smears over silhouettes: matches this near to one count less.
constexpr int kSmearPx = 3;
constexpr float kSmearWeight = 0.3F;
// Geometry knows depth no better than this share of it: surfaces are sampled at pixels.
constexpr float kModelShare = 5e-4F;

// The two scales of windows: one every `cell` pixels, over `radius`, reading every `step`-th pixel.
struct Scale {
  int cell, radius, step;
};
constexpr Scale kSmall = {8, 10, 2}, kLarge = {24, 36, 4};
constexpr int kWindowsPerCell = 3;         // surfaces that a cell may have a window of
constexpr int kFewestPixels = 4;           // of a surface in a cell
constexpr float kFewestMatches = 8;        // that agree, for a window to speak for itself
constexpr float kLeastAgreement = 0.3F;    // of its matches
constexpr float kMostDepthChange = 0.25F;  // share of depth: what changes more has met another surface
// Smaller changes are likelier: costs, reached at this share.
constexpr float kDepthChangeCost = 0.15F, kBigDepthChange = 0.15F;
constexpr float kFarthestShare = 0.4F;  // of the picture's longer side

// Search for windows that nothing explains.
constexpr float kSearchShare = 0.2F;  // of the picture's longer side, each way
constexpr size_t kFewestBlockPixels = 12;
constexpr float kBlockColor = 120.0F;  // sum over channels
constexpr float kBlockDepth = 0.5F;
constexpr float kMostBlockCost = 1.0F + kBlockDepth;
constexpr int kMostSearchPx = 100;
constexpr float kBadBlock = 0.36F;     // an explanation worse than this is worth a search,
constexpr float kBlockMargin = 0.10F;  // which must be better by this
constexpr float kGoodBlock = 0.22F;    // and good

constexpr int kAdoptionRounds = 40;  // how many cells a motion may travel along its surface
constexpr int kRounds = 2;           // the second starts its flow from what the first chose
constexpr int kMostDominant = 5;
constexpr float kAsGood = 0.97F;
constexpr float kDominantShare = 0.01F;  // of all matches
constexpr float kColorScale = 40.0F;     // sum over channels; window pixels that differ by it count half

// Costs, in shares of a full mismatch of colour.
constexpr float kHiddenCost = 0.30F;         // of leading behind what was measured, or out of the picture
constexpr float kHiddenAgainstFlow = 0.40F;  // more, where flow says that it stays in sight
constexpr float kSeesThroughCost = 1.0F;     // of leading in front of what was measured
constexpr float kDepthCost = 0.30F, kFlowCost = 0.20F;
constexpr float kFlowScalePx = 2.0F;
constexpr float kSmoothCost = 0.30F, kSmoothScalePx = 1.0F;
// What a motion must be better by, the less it is shared.
constexpr float kDominantPenalty = 0.01F, kLargePenalty = 0.02F, kSmallPenalty = 0.04F, kSearchedPenalty = 0.03F,
                kOwnPenalty = 0.25F;
// Windows: of leading elsewhere than the matches that texture determines; how far a candidate may be from the best; how
// much of that a pixel feels.
constexpr float kDisagreeCost = 0.30F, kMostWindowCost = 0.25F, kWindowShare = 0.5F;
// Of leaving the motion that the surface follows as a whole.
constexpr float kAloneCost = 0.30F;
constexpr int kSpeckPixels = 40;  // smaller surfaces are specks
constexpr size_t kMostCandidates = 6;
constexpr float kSeesThroughAtEdge = 0.3F;

int ColorDifference(Rgb8 a, Rgb8 b) { return std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b); }

struct Window {
  int label = -1;
  int x = 0, y = 0;  // the pixel it is about
  RigidMotion motion;
  float support = 0.0F;
  bool speaks = false;  // for itself, or by a neighbour on its surface
  std::optional<RigidMotion> searched;

  // Of the small ones: motions that may be those of its pixels, and what each costs more than the best of them.
  struct Candidate {
    RigidMotion motion;
    float penalty = 0.0F;
  };
  std::vector<Candidate> candidates;
};

class WindowGrid {
 public:
  WindowGrid(const Scale& scale, int width, int height)
      : scale_(scale),
        columns_((width + scale.cell - 1) / scale.cell),
        rows_((height + scale.cell - 1) / scale.cell),
        cells_(static_cast<size_t>(columns_) * rows_) {}

  const Scale& scale() const { return scale_; }
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  std::vector<Window>& cell(int column, int row) { return cells_[row * columns_ + column]; }
  const std::vector<Window>& cell(int column, int row) const { return cells_[row * columns_ + column]; }

  // Calls body(window) for those of the cell of a pixel and of the cells around it.
  template <typename Body>
  void ForNeighbours(int x, int y, const Body& body) const {
    const int column = x / scale_.cell, row = y / scale_.cell;
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, rows_ - 1); ++r)
      for (int c = std::max(column - 1, 0); c <= std::min(column + 1, columns_ - 1); ++c)
        for (const Window& window : cell(c, r)) body(window);
  }

 private:
  Scale scale_;
  int columns_, rows_;
  std::vector<std::vector<Window>> cells_;
};

class Estimator {
 public:
  explicit Estimator(const FramePair& pair)
      : pair_(pair),
        width_(pair.rays.width()),
        height_(pair.rays.height()),
        small_(kSmall, width_, height_),
        large_(kLarge, width_, height_) {}

  absl::StatusOr<SceneFlow> Run() {
    labels_ = LabelSurfaces(pair_.from.depth_m, pair_.noise);
    surface_pixels_.assign(1 + *std::max_element(labels_.data(), labels_.data() + labels_.pixel_count()), 0);
    for (size_t i = 0; i < labels_.pixel_count(); ++i) ++surface_pixels_[labels_.data()[i]];
    from_image_ = ToFloats(pair_.from.color);
    to_image_ = ToFloats(pair_.to.color);
    from_range_ = RangeAround(pair_.from.depth_m);
    to_range_ = RangeAround(pair_.to.depth_m);
    for (int round = 0; round < kRounds; ++round) {
      if (pair_.stop.stop_requested()) return absl::CancelledError("stopped on request");
      RETURN_IF_ERROR(FindMatches());
      dominant_.clear();
      FitWindows(large_);
      FindDominant();
      FitWindows(small_);
      AdoptMotions(large_);
      AdoptMotions(small_);
      ShareSurfaces();
      ForWindows(small_, [&](Window& window) { Search(window); });
      ForWindows(small_, [&](Window& window) { ListCandidates(window); });
      if (pair_.stop.stop_requested()) return absl::CancelledError("stopped on request");
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

  // Flow both ways, from `start` where there is one.
  absl::Status FindMatches() {
    constexpr DenseFlowOptions kFlow = {.finest_scale = 0};
    std::array<absl::StatusOr<Image<Flow2>>, 2> flows;
    ParallelFor(2, pair_.threads, [&](int i) {
      const Image<Flow2>& start = start_[i];
      flows[i] = DenseFlow(i == 0 ? pair_.from.luma : pair_.to.luma, i == 0 ? pair_.to.luma : pair_.from.luma, kFlow,
                           start.empty() ? nullptr : &start);
    });
    for (const auto& flow : flows) RETURN_IF_ERROR(flow.status());
    const Image<Flow2>& forward = *flows[0];
    const Image<Flow2>& backward = *flows[1];
    smeared_ = NearJumps();
    const Image<FlowInformation> information = Texture();
    matches_ = Image<PointMatch>(width_, height_);
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) {
          const float z = pair_.from.depth_m(x, y);
          const Flow2 there = forward(x, y);
          PointMatch& match = matches_(x, y);
          match.point = pair_.rays.Point(x, y, z);
          match.place = {static_cast<float>(x) + there.u, static_cast<float>(y) + there.v};
          match.depth_m = SampleSurface(pair_.to.depth_m, match.place.u, match.place.v, pair_.noise);
          match.depth_sigma_m = pair_.noise.At(match.depth_m) + kModelShare * match.depth_m;
          match.information = information(x, y);
          match.flow_weight = match.depth_weight = 0.0F;
          if (!pair_.to_rays.Inside(match.place)) continue;
          const Flow2 back = SampleFlow(backward, match.place.u, match.place.v);
          const float error = std::hypot(there.u + back.u, there.v + back.v) /
                              (kRoundTripPx + kRoundTripPerPx * std::hypot(there.u, there.v));
          match.flow_weight = std::exp(-error * error) / (1.0F + pair_.from.distance(x, y));
          if (smeared_(x, y) != 0) match.flow_weight *= kSmearWeight;
          if (std::abs(match.depth_m - z) > kMostDepthChange * z) match.flow_weight = 0.0F;  // met another surface
          if (match.flow_weight < 0.01F) match.flow_weight = 0.0F;
          const int nx = std::clamp(static_cast<int>(std::lround(match.place.u)), 0, width_ - 1);
          const int ny = std::clamp(static_cast<int>(std::lround(match.place.v)), 0, height_ - 1);
          match.depth_weight = match.flow_weight / (1.0F + pair_.to.distance(nx, ny));
        }
    });
    start_[1] = std::move(*flows[1]);  // what RestartFlow does not replace
    return absl::OkStatus();
  }

  // G / (G + noise) of the luma's gradients around each pixel: what noise could have made determines nothing.
  Image<FlowInformation> Texture() const {
    constexpr int kReach = 3;
    constexpr float kNoise = 8.0F;  // of a squared central difference, levels: a camera's noise of two
    const ImageView<const uint8_t> luma = pair_.from.luma;
    Image<FlowInformation> products(width_, height_), across(width_, height_), out(width_, height_);
    const auto add = [](FlowInformation& sum, const FlowInformation& g) {
      sum.xx += g.xx, sum.xy += g.xy, sum.yy += g.yy;
    };
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y) {
        for (int x = 0; x < width_; ++x) {
          const float gx = 0.5F * static_cast<float>(luma.Clamped(x + 1, y) - luma.Clamped(x - 1, y));
          const float gy = 0.5F * static_cast<float>(luma.Clamped(x, y + 1) - luma.Clamped(x, y - 1));
          products(x, y) = {gx * gx, gx * gy, gy * gy};
        }
        for (int x = 0; x < width_; ++x) {
          FlowInformation sum{0.0F, 0.0F, 0.0F};
          for (int i = -kReach; i <= kReach; ++i) add(sum, products(std::clamp(x + i, 0, width_ - 1), y));
          across(x, y) = sum;
        }
      }
    });
    ParallelRows(height_, pair_.threads, [&](int first, int last) {
      constexpr float kCount = (2 * kReach + 1) * (2 * kReach + 1);
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width_; ++x) {
          FlowInformation g{0.0F, 0.0F, 0.0F};
          for (int i = -kReach; i <= kReach; ++i) add(g, across(x, std::clamp(y + i, 0, height_ - 1)));
          const float xx = g.xx / kCount, xy = g.xy / kCount, yy = g.yy / kCount;
          const float determinant = (xx + kNoise) * (yy + kNoise) - xy * xy;
          out(x, y) = {(xx * (yy + kNoise) - xy * xy) / determinant, xy * kNoise / determinant,
                       (yy * (xx + kNoise) - xy * xy) / determinant};
        }
    });
    return out;
  }

  // Within kSmearPx of another surface, along rows or columns.
  Image<uint8_t> NearJumps() const {
    Image<uint8_t> near(width_, height_);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const bool right = x + 1 < width_ && labels_(x, y) != labels_(x + 1, y);
        const bool below = y + 1 < height_ && labels_(x, y) != labels_(x, y + 1);
        if (right)
          for (int i = std::max(x - kSmearPx + 1, 0); i <= std::min(x + kSmearPx, width_ - 1); ++i) near(i, y) = 1;
        if (below)
          for (int i = std::max(y - kSmearPx + 1, 0); i <= std::min(y + kSmearPx, height_ - 1); ++i) near(x, i) = 1;
      }
    return near;
  }

  // Where a match says that a pixel's point went.
  Float3 Found(const PointMatch& match) const {
    return pair_.to_rays.PointAt(match.place.u, match.place.v, match.depth_m);
  }

  // A window for each surface that has enough pixels in the cell, about the one nearest to the cell's middle.
  std::vector<Window> PlaceWindows(const Scale& scale, int column, int row) const {
    struct Part {
      int count = 0, nearest = std::numeric_limits<int>::max();
      Window window;
    };
    std::vector<Part> parts;
    const int middle_x = column * scale.cell + scale.cell / 2, middle_y = row * scale.cell + scale.cell / 2;
    for (int y = row * scale.cell; y < std::min((row + 1) * scale.cell, height_); ++y)
      for (int x = column * scale.cell; x < std::min((column + 1) * scale.cell, width_); ++x) {
        const int label = labels_(x, y);
        auto part = std::find_if(parts.begin(), parts.end(), [&](const Part& p) { return p.window.label == label; });
        if (part == parts.end()) part = parts.insert(part, Part{.window = {.label = label}});
        ++part->count;
        const int distance = (x - middle_x) * (x - middle_x) + (y - middle_y) * (y - middle_y);
        if (distance < part->nearest) part->nearest = distance, part->window.x = x, part->window.y = y;
      }
    std::stable_sort(parts.begin(), parts.end(), [](const Part& a, const Part& b) { return a.count > b.count; });
    std::vector<Window> windows;
    for (const Part& part : parts)
      if (part.count >= kFewestPixels && windows.size() < kWindowsPerCell) windows.push_back(part.window);
    return windows;
  }

  std::vector<PointMatch> MatchesOf(const Scale& scale, const Window& window) const {
    std::vector<PointMatch> matches;
    const Rgb8 color = pair_.from.color(window.x, window.y);
    const float spread = 1.0F / (0.5F * static_cast<float>(scale.radius * scale.radius));
    // Through the middle pixel, so that thin surfaces are met.
    for (int dy = -scale.radius / scale.step * scale.step; dy <= scale.radius; dy += scale.step)
      for (int dx = -scale.radius / scale.step * scale.step; dx <= scale.radius; dx += scale.step) {
        const int x = window.x + dx, y = window.y + dy;
        if (!labels_.Contains(x, y) || labels_(x, y) != window.label) continue;
        PointMatch match = matches_(x, y);
        if (!(match.flow_weight > 0.0F)) continue;
        const float unlike = static_cast<float>(ColorDifference(color, pair_.from.color(x, y))) / kColorScale;
        const float weight = std::exp(-spread * static_cast<float>(dx * dx + dy * dy)) / (1.0F + unlike * unlike);
        match.flow_weight *= weight;
        match.depth_weight *= weight;
        matches.push_back(match);
      }
    return matches;
  }

  void FitWindows(WindowGrid& grid) {
    ParallelFor(grid.rows(), pair_.threads, [&](int row) {
      for (int column = 0; column < grid.columns(); ++column) {
        grid.cell(column, row) = PlaceWindows(grid.scale(), column, row);
        for (Window& window : grid.cell(column, row)) Fit(grid.scale(), window);
      }
    });
  }

  void Fit(const Scale& scale, Window& window) const {
    const std::vector<PointMatch> matches = MatchesOf(scale, window);
    if (matches.empty()) return;
    std::vector<RigidMotion> starts = dominant_;
    starts.push_back(RigidMotion());
    // The window's own pixel, and a few spread over it.
    const PointMatch& own = matches_(window.x, window.y);
    if (own.flow_weight > 0.0F) starts.push_back(RigidMotion::Translation(Found(own) - own.point));
    constexpr size_t kSpread = 6;
    for (size_t i = 0; i < kSpread; ++i) {
      const PointMatch& match = matches[(2 * i + 1) * matches.size() / (2 * kSpread)];
      starts.push_back(RigidMotion::Translation(Found(match) - match.point));
    }
    RigidFit best;
    for (const RigidMotion& start : starts) {
      const RigidFit fit = Support(pair_.to_rays, matches, start, kStartFit);
      if (fit.support > best.support) best = fit;
    }
    if (!(best.support > 0.0F)) return;
    best = FitRigidMotion(pair_.to_rays, matches, best.motion, kFit);
    window.motion = best.motion;
    window.support = best.support;
    window.speaks = best.support >= kFewestMatches && best.support >= kLeastAgreement * best.possible &&
                    Plausible(window.x, window.y, best.motion * matches_(window.x, window.y).point);
  }

  // No farther than flow found anything to go, and not through the camera.
  bool Plausible(int x, int y, const Float3& moved) const {
    const float z = pair_.from.depth_m(x, y);
    if (!(std::abs(moved.z - z) <= kMostDepthChange * z)) return false;
    const Flow2 place = pair_.to_rays.Project(moved);
    return std::hypot(place.u - static_cast<float>(x), place.v - static_cast<float>(y)) <=
           kFarthestShare * static_cast<float>(std::max(width_, height_));
  }

  // Pixels of a window's surface, for comparing blocks.
  struct Block {
    std::vector<std::pair<int, int>> pixels;  // the window's own first
  };

  // How unlike the two frames are where a shift of the window by whole pixels, and of depth by that of its own pixel,
  // puts it: colour and depth.
  float ShiftCost(const Block& block, int du, int dv) const {
    const auto [cx, cy] = block.pixels[0];
    if (!labels_.Contains(cx + du, cy + dv)) return kMostBlockCost;
    const float dz = pair_.to.depth_m(cx + du, cy + dv) - pair_.from.depth_m(cx, cy);
    if (std::abs(dz) > kMostDepthChange * pair_.from.depth_m(cx, cy)) return kMostBlockCost;
    BlockSum sum;
    for (const auto& [x, y] : block.pixels) {
      AddPixel(x, y, x + du, y + dv, pair_.from.depth_m(x, y) + dz, kMostBlockCost, sum);
      if (sum.fixed > 0.5F * static_cast<float>(block.pixels.size())) return kMostBlockCost;
    }
    return Total(sum);
  }

  // The same of a rigid motion; pixels that it hides cost kHiddenCost.
  float MotionCost(const Block& block, const RigidMotion& motion) const {
    BlockSum sum;
    for (const auto& [x, y] : block.pixels) {
      const Float3 moved = motion * matches_(x, y).point;
      const Flow2 place = pair_.to_rays.Project(moved);
      const int px = static_cast<int>(std::lround(std::clamp(place.u, -1.0F, static_cast<float>(width_))));
      const int py = static_cast<int>(std::lround(std::clamp(place.v, -1.0F, static_cast<float>(height_))));
      const bool hidden = labels_.Contains(px, py) && moved.z > pair_.to.depth_m(px, py) &&
                          !SameLayer(moved.z, pair_.to.depth_m(px, py), pair_.noise);
      if (hidden) {
        sum.fixed += kHiddenCost;
        ++sum.without_color;
      } else {
        AddPixel(x, y, px, py, moved.z, kHiddenCost, sum);
      }
      sum.depth_change += std::abs(moved.z - matches_(x, y).point.z) / matches_(x, y).point.z;
    }
    return Total(sum) + DepthChangeCost(sum.depth_change / static_cast<float>(block.pixels.size()));
  }

  static float DepthChangeCost(float share) {
    const float big = share / kBigDepthChange;
    return kDepthChangeCost * std::min(big * big, 1.0F);
  }

  struct BlockSum {
    float fixed = 0.0F, depth_change = 0.0F;
    int without_color = 0, count = 0;
    std::array<Color4, 128> changes;
  };

  void AddPixel(int x, int y, int px, int py, float z, float outside, BlockSum& sum) const {
    if (!labels_.Contains(px, py)) {
      sum.fixed += outside;
      ++sum.without_color;
      return;
    }
    if (!SameLayer(z, pair_.to.depth_m(px, py), pair_.noise)) sum.fixed += kBlockDepth;
    sum.changes[sum.count++] = to_image_(px, py) - from_image_(x, y);
  }

  static float Total(const BlockSum& sum) {
    Color4 shared = {};
    for (int i = 0; i < sum.count; ++i) shared += sum.changes[i];
    shared /= static_cast<float>(std::max(sum.count, 1));
    float unlike = 0.0F;
    for (int i = 0; i < sum.count; ++i)
      unlike += std::min(Sum(Abs(sum.changes[i] - shared)) + ColorPatch::kSharedChange * Sum(Abs(shared)), kBlockColor);
    return (sum.fixed + unlike / kBlockColor) / static_cast<float>(sum.count + sum.without_color);
  }

  template <typename Body>
  void ForWindows(WindowGrid& grid, const Body& body) const {
    ParallelFor(grid.rows(), pair_.threads, [&](int row) {
      for (int column = 0; column < grid.columns(); ++column)
        for (Window& window : grid.cell(column, row)) body(window);
    });
  }

  // The pixels of a small window on its surface.
  Block BlockOf(const Window& window) const {
    Block block{{{window.x, window.y}}};
    const int radius = small_.scale().radius;
    for (int dy = -radius; dy <= radius; dy += small_.scale().step)
      for (int dx = -radius; dx <= radius; dx += small_.scale().step)
        if ((dx != 0 || dy != 0) && labels_.Contains(window.x + dx, window.y + dy) &&
            labels_(window.x + dx, window.y + dy) == window.label)
          block.pixels.emplace_back(window.x + dx, window.y + dy);
    return block;
  }

  // A window that no known motion explains, as of a small thing that went far, is looked for all around.
  void Search(Window& window) const {
    window.searched.reset();
    const Block block = BlockOf(window);
    if (block.pixels.size() < kFewestBlockPixels) return;
    float best = window.speaks ? MotionCost(block, window.motion) : kMostBlockCost;
    for (const RigidMotion& motion : dominant_) best = std::min(best, MotionCost(block, motion));
    if (best < kBadBlock) return;
    best = std::min(best - kBlockMargin, kGoodBlock);
    std::pair<int, int> found = {0, 0};
    bool any = false;
    const auto look = [&](int du, int dv) {
      const float cost = ShiftCost(block, du, dv);
      if (cost < best) best = cost, found = {du, dv}, any = true;
    };
    const int reach =
        std::min(static_cast<int>(kSearchShare * static_cast<float>(std::max(width_, height_))), kMostSearchPx);
    for (int dv = -reach; dv <= reach; dv += 2)
      for (int du = -reach; du <= reach; du += 2) look(du, dv);
    if (!any) return;
    const auto [u, v] = found;
    for (int dv = -1; dv <= 1; ++dv)
      for (int du = -1; du <= 1; ++du) look(u + du, v + dv);
    const int x = window.x + found.first, y = window.y + found.second;
    window.searched = RigidMotion::Translation(
        pair_.to_rays.PointAt(static_cast<float>(x), static_cast<float>(y), pair_.to.depth_m(x, y)) -
        matches_(window.x, window.y).point);
  }

  // How much of each surface moves with each dominant motion: sums of the weights of matches.
  void ShareSurfaces() {
    constexpr int kEvery = 2;
    followers_.assign(dominant_.size() + 1, std::vector<float>(surface_pixels_.size(), 0.0F));
    for (int y = 0; y < height_; y += kEvery)
      for (int x = 0; x < width_; x += kEvery) {
        const std::array<PointMatch, 1> match = {matches_(x, y)};
        if (!(match[0].flow_weight > 0.0F)) continue;
        const int label = labels_(x, y);
        for (size_t i = 0; i < dominant_.size(); ++i) {
          const RigidFit fit = Support(pair_.to_rays, match, dominant_[i], kFit);
          followers_[i][label] += fit.support;
          if (i == 0) followers_.back()[label] += fit.possible;
        }
      }
  }
  // What following a dominant motion saves on a surface that follows it as a whole; 0 up to half of it.
  float Shared(int label, size_t dominant) const {
    const float all = followers_.back()[label] + kFewestMatches;
    return kAloneCost * std::max(2.0F * followers_[dominant][label] / all - 1.0F, 0.0F);
  }
  // What not following costs.
  float AloneCost(int label) const {
    float most = 0.0F;
    for (size_t i = 0; i < dominant_.size(); ++i) most = std::max(most, Shared(label, i));
    return most;
  }

  // Of all motions known around a window, those that explain it nearly as well as the best does.
  void ListCandidates(Window& window) const {
    const Block block = BlockOf(window);
    const std::vector<PointMatch> matches = MatchesOf(small_.scale(), window);
    std::vector<Window::Candidate> all;
    const auto propose = [&](const RigidMotion& motion, float penalty) {
      const RigidFit fit = Support(pair_.to_rays, matches, motion, kFit);
      const float disagree = fit.possible > 0.0F ? 1.0F - fit.support / fit.possible : 0.0F;
      const float heard = std::min(fit.possible / kFewestMatches, 1.0F);
      all.push_back({motion, penalty + MotionCost(block, motion) + kDisagreeCost * heard * disagree});
    };
    const float alone = AloneCost(window.label);
    for (size_t i = 0; i < dominant_.size(); ++i)
      propose(dominant_[i], (i == 0 ? 0.0F : kDominantPenalty) + alone - Shared(window.label, i));
    const auto from = [&](const WindowGrid& grid, float penalty) {
      grid.ForNeighbours(window.x, window.y, [&](const Window& other) {
        if (other.label != window.label) return;
        if (other.speaks) propose(other.motion, penalty + alone);
        if (other.searched) propose(*other.searched, kSearchedPenalty + alone);
      });
    };
    from(large_, kLargePenalty);
    from(small_, kSmallPenalty);
    if (all.empty()) propose(RigidMotion(), 0.0F);
    std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.penalty < b.penalty; });
    const float best = all.front().penalty;
    window.candidates.clear();
    for (const Window::Candidate& candidate : all) {
      const float more = candidate.penalty - best;
      if (window.candidates.size() == kMostCandidates || more > kMostWindowCost) break;
      window.candidates.push_back({candidate.motion, kWindowShare * more});
    }
  }

  // What was chosen, as flow both ways. Backward where a chosen motion arrives, nearest first; else as it was.
  void RestartFlow() {
    Image<float> nearest(width_, height_);
    start_[0] = Image<Flow2>(width_, height_);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const Float3 moved = choices_(x, y).motion * matches_(x, y).point;
        const Flow2 place = pair_.to_rays.Project(moved);
        const Flow2 flow = {place.u - static_cast<float>(x), place.v - static_cast<float>(y)};
        if (!pair_.to_rays.Inside(place)) {
          start_[0](x, y) = {matches_(x, y).place.u - static_cast<float>(x),
                             matches_(x, y).place.v - static_cast<float>(y)};
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

  // Of the large windows' motions the one that explains most matches of the frame, fitted to all of them; then the next
  // one for what is left, and so on.
  void FindDominant() {
    constexpr int kEvery = 4;
    std::vector<PointMatch> left;
    for (int y = kEvery / 2; y < height_; y += kEvery)
      for (int x = kEvery / 2; x < width_; x += kEvery)
        if (matches_(x, y).flow_weight > 0.0F) left.push_back(matches_(x, y));
    std::vector<RigidMotion> proposals = {RigidMotion()};
    for (int row = 0; row < large_.rows(); ++row)
      for (int column = 0; column < large_.columns(); ++column)
        for (const Window& window : large_.cell(column, row))
          if (window.speaks) proposals.push_back(window.motion);
    float all = 0.0F;
    for (const PointMatch& match : left) all += match.flow_weight;
    while (static_cast<int>(dominant_.size()) < kMostDominant && !left.empty()) {
      std::vector<float> supports(proposals.size());
      ParallelFor(static_cast<int>(proposals.size()), pair_.threads,
                  [&](int i) { supports[i] = Support(pair_.to_rays, left, proposals[i], kFit).support; });
      const auto best = std::max_element(supports.begin(), supports.end()) - supports.begin();
      if (supports[best] < kDominantShare * all) break;
      RigidFitOptions thorough = kFit;
      thorough.iterations = 15;
      RigidFit fit = FitRigidMotion(pair_.to_rays, left, proposals[best], thorough);
      // A camera on a stand is likelier than one that moves by less than flow can tell.
      if (dominant_.empty() && supports[0] > kAsGood * fit.support) fit.motion = RigidMotion();
      dominant_.push_back(fit.motion);
      // What it explains is taken away.
      std::erase_if(left, [&](const PointMatch& match) {
        const std::array<PointMatch, 1> one = {match};
        return Support(pair_.to_rays, one, fit.motion, kFit).support > 0.25F * match.flow_weight;
      });
    }
  }

  // Windows that do not speak take the motion of the neighbour of most support on their surface.
  static void AdoptMotions(WindowGrid& grid) {
    for (int round = 0; round < kAdoptionRounds; ++round) {
      std::vector<std::pair<Window*, Window>> adopted;
      for (int row = 0; row < grid.rows(); ++row)
        for (int column = 0; column < grid.columns(); ++column)
          for (Window& window : grid.cell(column, row)) {
            if (window.speaks) continue;
            const Window* from = nullptr;
            grid.ForNeighbours(column * grid.scale().cell, row * grid.scale().cell, [&](const Window& other) {
              if (other.speaks && other.label == window.label && (from == nullptr || other.support > from->support))
                from = &other;
            });
            if (from != nullptr) adopted.emplace_back(&window, *from);
          }
      if (adopted.empty()) return;
      for (const auto& [window, from] : adopted) {
        window->motion = from.motion;
        window->support = from.support;
        window->speaks = true;
      }
    }
  }

  Verdict Judge(const ColorPatch& patch, int x, int y, const RigidMotion& motion, float limit) const {
    const PointMatch& match = matches_(x, y);
    const Float3 moved = motion * match.point;
    if (!Plausible(x, y, moved)) return {};
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
    if (before && !speck) cost += (smeared_(x, y) != 0 ? kSeesThroughAtEdge : kSeesThroughCost) * trust;
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
    const auto propose = [&](const RigidMotion& motion, float penalty) {
      const Verdict verdict = Judge(patch, x, y, motion, best.cost - penalty);
      if (verdict.cost + penalty < best.cost) best = {motion, verdict.cost + penalty, penalty, verdict.hidden};
    };
    if (surface_pixels_[labels_(x, y)] < kSpeckPixels)
      for (const RigidMotion& motion : dominant_) propose(motion, 0.0F);
    // Those of the nearest window on its surface; a speck without one belongs to one of the surfaces around it.
    const Window* nearest = nullptr;
    small_.ForNeighbours(x, y, [&](const Window& window) {
      const auto far = [&](const Window& w) {
        return (w.label == labels_(x, y) ? 0 : 1000) + std::abs(w.x - x) + std::abs(w.y - y);
      };
      if (nearest == nullptr || far(window) < far(*nearest)) nearest = &window;
    });
    if (nearest != nullptr)
      for (const Window::Candidate& candidate : nearest->candidates) propose(candidate.motion, candidate.penalty);
    const PointMatch& own = matches_(x, y);
    if (own.flow_weight > 0.0F)
      propose(RigidMotion::Translation(Found(own) - own.point), kOwnPenalty + kWindowShare * AloneCost(labels_(x, y)));
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
          const Float3 point = matches_(x, y).point;
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
          const Float3 point = matches_(x, y).point;
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

  static constexpr float kWorstCost = 4.0F;  // more than any verdict
  static constexpr float kHiddenConfidence = 0.2F, kLeastConfidence = 0.01F;
  // Starts are translations of one pixel each, with its noise.
  static constexpr RigidFitOptions kFit = {.flow_sigma_px = 0.3F};
  static constexpr RigidFitOptions kStartFit = {.flow_sigma_px = 0.6F};

  const FramePair& pair_;
  const int width_, height_;
  std::array<Image<Flow2>, 2> start_;  // of the flow, forward and backward; empty in the first round
  Image<PointMatch> matches_;
  Image<int> labels_;
  Image<uint8_t> smeared_;
  WindowGrid small_, large_;
  std::vector<RigidMotion> dominant_;
  std::vector<std::vector<float>> followers_;  // by dominant motion, then of all matches; by surface
  std::vector<int> surface_pixels_;            // by surface
  Image<Color4> from_image_, to_image_;
  Image<DepthRange> from_range_, to_range_;
  Image<Choice> choices_;
};

}  // namespace

absl::StatusOr<SceneFlow> RigidWindowsFlow(const FramePair& pair) { return Estimator(pair).Run(); }

}  // namespace depthtween
