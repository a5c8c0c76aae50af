#include "core/sceneflow/surface_windows.h"

#include <array>
#include <cstdlib>
#include <limits>
#include <span>
#include <utility>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// The two scales of windows: one every `cell` pixels, over `radius`, reading every `step`-th pixel.
constexpr WindowScale kSmall = {8, 10, 2}, kLarge = {24, 36, 4};
constexpr int kWindowsPerCell = 3;       // surfaces that a cell may have a window of
constexpr int kFewestPixels = 4;         // of a surface in a cell
constexpr float kFewestMatches = 8;      // that agree, for a window to speak for itself
constexpr float kLeastAgreement = 0.3F;  // of its matches

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
constexpr float kFarCost = 0.1F;       // of places as good the nearer one: what has no texture is like itself anywhere

constexpr int kAdoptionRounds = 40;  // how many cells a motion may travel along its surface
constexpr int kMostDominant = 5;
constexpr float kAsGood = 0.97F;         // share of the best support that makes standing still as good
constexpr float kDominantShare = 0.01F;  // of all matches
constexpr float kColorScale = 40.0F;     // sum over channels; window pixels that differ by it count half

// What a motion must be better by, the less it is shared.
constexpr float kDominantPenalty = 0.01F, kLargePenalty = 0.02F, kSmallPenalty = 0.04F, kSearchedPenalty = 0.03F,
                kProposedPenalty = 0.04F;
// A window that something explains better than this takes no proposal: being hidden costs less, and what is hidden
// range flow drags along.
constexpr float kExplained = 0.5F;
// Of leading elsewhere than the matches that texture determines; and how far a candidate may be from the best.
constexpr float kDisagreeCost = 0.30F, kMostWindowCost = 0.25F;
// Of leaving the motion that the surface follows as a whole.
constexpr float kAloneCost = 0.45F;
constexpr size_t kMostCandidates = 6;
constexpr float kFarthestShare = 0.4F;  // of the picture's longer side
// Starts are translations of one pixel each, with its noise.
constexpr RigidFitOptions kWindowFit = {.flow_sigma_px = 0.3F};
constexpr RigidFitOptions kStartFit = {.flow_sigma_px = 0.6F};
constexpr RigidFitOptions kProposalFit = {.flow_sigma_px = 0.6F}, kProposalStartFit = {.flow_sigma_px = 1.0F};
// For a proposal; what agrees with it is looked at again.
constexpr size_t kFewestProposals = 4;
constexpr float kLeastProposalSupport = 1.0F;

int ColorDifference(Rgb8 a, Rgb8 b) { return std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b); }

class Fitter {
 public:
  Fitter(const FramePair& pair, ImageView<const int> labels, ImageView<const Color4> from_image,
         ImageView<const Color4> to_image, const Image<PointMatch>& matches,
         std::span<const Image<PointMatch>* const> proposals)
      : pair_(pair),
        labels_(labels),
        from_image_(from_image),
        to_image_(to_image),
        matches_(matches),
        proposals_(proposals),
        width_(labels.width()),
        height_(labels.height()),
        small_(kSmall, width_, height_),
        large_(kLarge, width_, height_) {
    for (int y = 0; y < height_; ++y)
      surface_count_ = std::max(surface_count_, 1 + *std::max_element(labels.row(y), labels.row(y) + width_));
  }

  SurfaceWindows Run() {
    FitWindows(large_);
    FindDominant();
    FitWindows(small_);
    AdoptMotions(large_);
    AdoptMotions(small_);
    ShareSurfaces();
    ForWindows(small_, [&](Window& window) {
      for (const Image<PointMatch>* const matches : proposals_)
        if (!matches->empty()) Propose(*matches, window);
    });
    ForWindows(small_, [&](Window& window) { Search(window); });
    ForWindows(small_, [&](Window& window) { ListCandidates(window); });
    return {std::move(dominant_), std::move(small_), std::move(alone_cost_)};
  }

 private:
  // A window for each surface that has enough pixels in the cell, about the one nearest to the cell's middle.
  std::vector<Window> PlaceWindows(const WindowScale& scale, int column, int row) const {
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

  std::vector<PointMatch> MatchesOf(const Image<PointMatch>& all, const WindowScale& scale,
                                    const Window& window) const {
    std::vector<PointMatch> matches;
    const Rgb8 color = pair_.from.color(window.x, window.y);
    const float spread = 1.0F / (0.5F * static_cast<float>(scale.radius * scale.radius));
    // Through the middle pixel, so that thin surfaces are met.
    for (int dy = -scale.radius / scale.step * scale.step; dy <= scale.radius; dy += scale.step)
      for (int dx = -scale.radius / scale.step * scale.step; dx <= scale.radius; dx += scale.step) {
        const int x = window.x + dx, y = window.y + dy;
        if (!labels_.Contains(x, y) || labels_(x, y) != window.label) continue;
        PointMatch match = all(x, y);
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

  void Fit(const WindowScale& scale, Window& window) const {
    const std::vector<PointMatch> matches = MatchesOf(matches_, scale, window);
    if (matches.empty()) return;
    const RigidFit fit = BestFit(matches, matches_(window.x, window.y), dominant_, kStartFit, kWindowFit);
    if (!(fit.support > 0.0F)) return;
    window.motion = fit.motion;
    window.support = fit.support;
    window.speaks = fit.support >= kFewestMatches && Agreed(fit, window);
  }

  void Propose(const Image<PointMatch>& all, Window& window) const {
    const std::vector<PointMatch> matches = MatchesOf(all, small_.scale(), window);
    if (matches.size() < kFewestProposals) return;
    const RigidFit fit = BestFit(matches, all(window.x, window.y), {}, kProposalStartFit, kProposalFit);
    if (fit.support >= kLeastProposalSupport && Agreed(fit, window)) window.proposed.push_back(fit.motion);
  }

  bool Agreed(const RigidFit& fit, const Window& window) const {
    return fit.support >= kLeastAgreement * fit.possible &&
           Plausible(pair_, window.x, window.y, fit.motion * matches_(window.x, window.y).point);
  }

  // From the start that most of a window's matches support, `own` being that of its pixel; of support 0 if none do.
  RigidFit BestFit(std::span<const PointMatch> matches, const PointMatch& own, std::vector<RigidMotion> starts,
                   const RigidFitOptions& start_options, const RigidFitOptions& options) const {
    starts.push_back(RigidMotion());
    // The window's own pixel, and a few spread over it.
    if (own.flow_weight > 0.0F) starts.push_back(RigidMotion::Translation(FoundPoint(pair_, own) - own.point));
    constexpr size_t kSpread = 6;
    for (size_t i = 0; i < kSpread; ++i) {
      const PointMatch& match = matches[(2 * i + 1) * matches.size() / (2 * kSpread)];
      starts.push_back(RigidMotion::Translation(FoundPoint(pair_, match) - match.point));
    }
    RigidFit best;
    for (const RigidMotion& start : starts) {
      const RigidFit fit = Support(pair_.to_rays, matches, start, start_options);
      if (fit.support > best.support) best = fit;
    }
    return best.support > 0.0F ? FitRigidMotion(pair_.to_rays, matches, best.motion, options) : best;
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

  // Searches the surroundings for a window that no known motion explains, such as one on a small, fast thing.
  void Search(Window& window) const {
    window.searched.reset();
    const Block block = BlockOf(window);
    if (block.pixels.size() < kFewestBlockPixels) return;
    float best = window.speaks ? MotionCost(block, window.motion) : kMostBlockCost;
    for (const RigidMotion& motion : dominant_) best = std::min(best, MotionCost(block, motion));
    if (best < kBadBlock) return;
    const float good = std::min(best - kBlockMargin, kGoodBlock);
    const int reach =
        std::min(static_cast<int>(kSearchShare * static_cast<float>(std::max(width_, height_))), kMostSearchPx);
    float least = std::numeric_limits<float>::max();
    std::pair<int, int> found = {0, 0};
    const auto look = [&](int du, int dv) {
      const float far =
          kFarCost * std::hypot(static_cast<float>(du), static_cast<float>(dv)) / static_cast<float>(reach);
      const float cost = ShiftCost(block, du, dv);
      if (cost < good && cost + far < least) least = cost + far, found = {du, dv};
    };
    for (int dv = -reach; dv <= reach; dv += 2)
      for (int du = -reach; du <= reach; du += 2) look(du, dv);
    if (least == std::numeric_limits<float>::max()) return;
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
    followers_.assign(dominant_.size() + 1, std::vector<float>(surface_count_, 0.0F));
    for (int y = 0; y < height_; y += kEvery)
      for (int x = 0; x < width_; x += kEvery) {
        const std::array<PointMatch, 1> match = {matches_(x, y)};
        if (!(match[0].flow_weight > 0.0F)) continue;
        const int label = labels_(x, y);
        for (size_t i = 0; i < dominant_.size(); ++i) {
          const RigidFit fit = Support(pair_.to_rays, match, dominant_[i], kWindowFit);
          followers_[i][label] += fit.support;
          if (i == 0) followers_.back()[label] += fit.possible;
        }
      }
    alone_cost_.assign(surface_count_, 0.0F);
    for (int label = 0; label < surface_count_; ++label)
      for (size_t i = 0; i < dominant_.size(); ++i) alone_cost_[label] = std::max(alone_cost_[label], Shared(label, i));
  }
  // What following a dominant motion saves on a surface that follows it as a whole; 0 up to half of it.
  float Shared(int label, size_t dominant) const {
    const float all = followers_.back()[label] + kFewestMatches;
    return kAloneCost * std::max(2.0F * followers_[dominant][label] / all - 1.0F, 0.0F);
  }
  // Of all motions known around a window, those that explain it nearly as well as the best does.
  void ListCandidates(Window& window) const {
    const Block block = BlockOf(window);
    const std::vector<PointMatch> matches = MatchesOf(matches_, small_.scale(), window);
    std::vector<Window::Candidate> all;
    float least = std::numeric_limits<float>::max();
    const auto propose = [&](const RigidMotion& motion, float penalty, bool seen_only = false) {
      const RigidFit fit = Support(pair_.to_rays, matches, motion, kWindowFit);
      const float disagree = fit.possible > 0.0F ? 1.0F - fit.support / fit.possible : 0.0F;
      const float heard = std::min(fit.possible / kFewestMatches, 1.0F);
      const float cost = penalty + MotionCost(block, motion) + kDisagreeCost * heard * disagree;
      all.push_back({motion, cost, seen_only});
      least = std::min(least, cost);
    };
    const float alone = alone_cost_[window.label];
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
    if (least > kExplained)
      small_.ForNeighbours(window.x, window.y, [&](const Window& other) {
        if (other.label != window.label) return;
        for (const RigidMotion& motion : other.proposed) propose(motion, kProposedPenalty + alone, true);
      });
    if (all.empty()) propose(RigidMotion(), 0.0F);
    std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.penalty < b.penalty; });
    const float best = all.front().penalty;
    window.candidates.clear();
    for (const Window::Candidate& candidate : all) {
      const float more = candidate.penalty - best;
      if (window.candidates.size() == kMostCandidates || more > kMostWindowCost) break;
      window.candidates.push_back({candidate.motion, kWindowShare * more, candidate.seen_only});
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
                  [&](int i) { supports[i] = Support(pair_.to_rays, left, proposals[i], kWindowFit).support; });
      const auto best = std::max_element(supports.begin(), supports.end()) - supports.begin();
      if (supports[best] < kDominantShare * all) break;
      RigidFitOptions thorough = kWindowFit;
      thorough.iterations = 15;
      RigidFit fit = FitRigidMotion(pair_.to_rays, left, proposals[best], thorough);
      // A camera on a stand is likelier than one that moves by less than flow can tell.
      if (dominant_.empty() && supports[0] > kAsGood * fit.support) fit.motion = RigidMotion();
      dominant_.push_back(fit.motion);
      // Removes the matches that it explains.
      std::erase_if(left, [&](const PointMatch& match) {
        const std::array<PointMatch, 1> one = {match};
        return Support(pair_.to_rays, one, fit.motion, kWindowFit).support > 0.25F * match.flow_weight;
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

  const FramePair& pair_;
  const ImageView<const int> labels_;
  const ImageView<const Color4> from_image_, to_image_;
  const Image<PointMatch>& matches_;
  const std::span<const Image<PointMatch>* const> proposals_;
  const int width_, height_;
  int surface_count_ = 0;
  WindowGrid small_, large_;
  std::vector<RigidMotion> dominant_;
  std::vector<std::vector<float>> followers_;  // by dominant motion, then of all matches; by surface
  std::vector<float> alone_cost_;              // by surface
};

}  // namespace

bool Plausible(const FramePair& pair, int x, int y, const Float3& moved) {
  const float z = pair.from.depth_m(x, y);
  if (!(std::abs(moved.z - z) <= kMostDepthChange * z)) return false;
  const Flow2 place = pair.to_rays.Project(moved);
  return std::hypot(place.u - static_cast<float>(x), place.v - static_cast<float>(y)) <=
         kFarthestShare * static_cast<float>(std::max(pair.rays.width(), pair.rays.height()));
}

SurfaceWindows FitSurfaceWindows(const FramePair& pair, ImageView<const int> labels, ImageView<const Color4> from_image,
                                 ImageView<const Color4> to_image, const Image<PointMatch>& matches,
                                 std::span<const Image<PointMatch>* const> proposals) {
  return Fitter(pair, labels, from_image, to_image, matches, proposals).Run();
}

}  // namespace depthtween
