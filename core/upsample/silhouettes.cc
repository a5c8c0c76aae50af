#include "core/upsample/silhouettes.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>

#include "core/base/lanes.h"

namespace depthtween {
namespace {

constexpr int kWindowRadius = 7;          // of the neighbours that vote and show how their surface moves
constexpr int kChangeRadius = 2;          // a change this near makes a pixel worth another look
constexpr float kSpaceSigma = 2.5F;       // pixels
constexpr float kLikeSigma = 8.0F;        // sRGB units, over three channels: noise of a camera
constexpr float kAkinSigma = 20.0F;       // shading, texture
constexpr float kUnconfirmedVote = 0.3F;  // of a neighbour whose own surface is not certain
constexpr float kNoVote = 1e-3F;          // keeps the ratio of votes finite
constexpr float kCostScale = 4.0F;        // a motion whose match is worse by this counts about 1/e
constexpr float kDepthMoves = 0.1F;       // share of depth that a surface may change between the target and a key
constexpr float kWorstColor = 40.0F;      // sRGB units: more than this is hidden, not different
constexpr float kMostConstancy = 20.0F;

float Difference(const Rgb8& color, ImageView<const Rgb8> image, float x, float y) {
  x = std::clamp(x, 0.0F, static_cast<float>(image.width() - 1));
  y = std::clamp(y, 0.0F, static_cast<float>(image.height() - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width() - 1), y1 = std::min(y0 + 1, image.height() - 1);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const Rgb8 p = image(x0, y0), q = image(x1, y0), r = image(x0, y1), s = image(x1, y1);
  const auto channel = [&](uint8_t own, uint8_t a, uint8_t b, uint8_t c, uint8_t d) {
    const float top = (1 - ax) * static_cast<float>(a) + ax * static_cast<float>(b);
    const float bottom = (1 - ax) * static_cast<float>(c) + ax * static_cast<float>(d);
    return std::abs(static_cast<float>(own) - ((1 - ay) * top + ay * bottom));
  };
  return (channel(color.r, p.r, q.r, r.r, s.r) + channel(color.g, p.g, q.g, r.g, s.g) +
          channel(color.b, p.b, q.b, r.b, s.b)) /
         3;
}

// About exp(-d / scale), but 0 from 8 scales on, and cheap: the eighth power of a falling line.
Lanes Falloff(Lanes d, float scale) {
  const Lanes line = 1.0F - d * (0.125F / scale);
  const Lanes at_least_0 = KeepLanes(line > AllLanes(0), line);
  const Lanes power2 = at_least_0 * at_least_0, power4 = power2 * power2;
  return power4 * power4;
}

// The window of neighbours is as many columns wide, from a first one that keeps it inside the image, ...
constexpr int kColumns = 2 * kLanes;
static_assert(2 * kWindowRadius + 1 <= kColumns);
// ... and the weights of the columns by their distance to the pixel, -(kColumns - 1) to kColumns - 1, are 0 beyond the
// radius.
constexpr int kDistances = 2 * kColumns;
using RowWeights = std::array<float, kDistances>;
std::array<RowWeights, 2 * kWindowRadius + 1> WindowWeights() {
  std::array<RowWeights, 2 * kWindowRadius + 1> rows = {};
  for (int dy = -kWindowRadius; dy <= kWindowRadius; ++dy)
    for (int dx = -kWindowRadius; dx <= kWindowRadius; ++dx)
      if (dx != 0 || dy != 0)
        rows[dy + kWindowRadius][dx + kColumns - 1] =
            std::exp(static_cast<float>(-dx * dx - dy * dy) / (2 * kSpaceSigma * kSpaceSigma));
  return rows;
}

// Mean motion of a surface around a pixel to a key, and its depth there.
struct SurfaceMotion {
  float weight = 0, u = 0, v = 0, depth_m = 0;
};

class Looker {
 public:
  explicit Looker(const SilhouetteInput& input)
      : in_(input), target_(input.window[input.target]), depth_(target_.depth_m), weights_(WindowWeights()) {
    const ImageView<const Rgb8> color = target_.color;
    for (Image<float>& plane : color_) plane = Image<float>(color.width(), color.height());
    for (int y = 0; y < color.height(); ++y)
      for (int x = 0; x < color.width(); ++x) {
        const Rgb8 c = color(x, y);
        color_[0](x, y) = c.r, color_[1](x, y) = c.g, color_[2](x, y) = c.b;
      }
  }

  std::vector<SilhouettePixel> Look() const {
    std::vector<SilhouettePixel> out;
    if (depth_.width() < kColumns) return out;
    for (int y = 0; y < depth_.height(); ++y)
      for (int x = 0; x < depth_.width(); ++x)
        if (std::optional<SilhouettePixel> pixel = BesideJump(x, y); pixel && NearChange(x, y)) {
          Weigh(*pixel);
          out.push_back(*pixel);
        }
    return out;
  }

 private:
  bool Same(float a, float b) const { return SameLayer(a, b, in_.noise); }

  // The pixel with the depths between which to decide.
  std::optional<SilhouettePixel> BesideJump(int x, int y) const {
    const float own = depth_(x, y);
    const auto other_layer = [&](int dx, int dy) {
      const float z = depth_.Clamped(x + dx, y + dy);
      return z > 0 && !Same(z, own) ? z : 0.0F;
    };
    if (own <= 0) return std::nullopt;
    for (const auto& [dx, dy] : {std::pair{0, -1}, {-1, 0}, {1, 0}, {0, 1}})
      if (const float other = other_layer(dx, dy); other > 0)
        return SilhouettePixel{x, y, std::min(own, other), std::max(own, other), own < other, {}};
    return std::nullopt;
  }

  bool NearChange(int x, int y) const {
    if (in_.changed.empty()) return true;
    for (int ny = std::max(0, y - kChangeRadius); ny <= std::min(depth_.height() - 1, y + kChangeRadius); ++ny)
      for (int nx = std::max(0, x - kChangeRadius); nx <= std::min(depth_.width() - 1, x + kChangeRadius); ++nx)
        if (in_.changed(nx, ny)) return true;
    return false;
  }

  // What the neighbours on the near [0] and the far surface [1] show.
  struct Surroundings {
    float like[2], akin[2];      // their votes by likeness of colour
    SurfaceMotion motion[2][2];  // [surface][key]
  };
  Surroundings LookAround(const SilhouettePixel& pixel) const {
    const Lanes own[3] = {AllLanes(color_[0](pixel.x, pixel.y)), AllLanes(color_[1](pixel.x, pixel.y)),
                          AllLanes(color_[2](pixel.x, pixel.y))};
    const Lanes depth[2] = {AllLanes(pixel.near_m), AllLanes(pixel.far_m)};
    const Lanes within[2] = {AllLanes(WidestGap(pixel.near_m, in_.noise)), AllLanes(WidestGap(pixel.far_m, in_.noise))};
    Lanes like[2] = {}, akin[2] = {}, weight[2][2] = {}, u[2][2] = {}, v[2][2] = {}, there[2][2] = {};
    const int first = std::clamp(pixel.x - kWindowRadius, 0, depth_.width() - kColumns);
    const int bottom = std::min(depth_.height() - 1, pixel.y + kWindowRadius);
    for (int y = std::max(0, pixel.y - kWindowRadius); y <= bottom; ++y) {
      const float* const row_weights = &weights_[y - pixel.y + kWindowRadius][first - pixel.x + kColumns - 1];
      for (int column = 0; column < kColumns; column += kLanes) {
        const int x = first + column;
        const Lanes z = LoadLanes(depth_.row(y) + x);
        const Lanes off[2] = {AbsLanes(z - depth[0]), AbsLanes(z - depth[1])};
        const LaneInts nearer = off[0] < off[1];
        const LaneInts on[2] = {nearer & (off[0] <= within[0]), ~nearer & (off[1] <= within[1])};
        const Lanes space = LoadLanes(row_weights + column);
        Lanes distance = {};
        for (int c = 0; c < 3; ++c) {
          const Lanes difference = LoadLanes(color_[c].row(y) + x) - own[c];
          distance += difference * difference;
        }
        const Lanes vote = space * LoadVotes(x, y);
        const Lanes by_like = vote * Falloff(distance, 2 * kLikeSigma * kLikeSigma);
        const Lanes by_akin = vote * Falloff(distance, 2 * kAkinSigma * kAkinSigma);
        for (int surface = 0; surface < 2; ++surface) {
          like[surface] += KeepLanes(on[surface], by_like);
          akin[surface] += KeepLanes(on[surface], by_akin);
        }
        for (int s = 0; s < 2; ++s) {
          const SideChoice& side = in_.choice->sides[s];
          const Lanes z_there = LoadLanes(side.depth_m.row(y) + x);
          const LaneInts same = AbsLanes(z_there - z) <= kDepthMoves * z;
          const Lanes count = KeepLanes(same, space * Falloff(LoadLanes(side.cost.row(y) + x), kCostScale));
          const auto* const motion = reinterpret_cast<const float*>(side.motion.row(y) + x);
          const Lanes low = LoadLanes(motion), high = LoadLanes(motion + kLanes);
          const Lanes m_u = __builtin_shufflevector(low, high, 0, 2, 4, 6, 8, 10, 12, 14);
          const Lanes m_v = __builtin_shufflevector(low, high, 1, 3, 5, 7, 9, 11, 13, 15);
          for (int surface = 0; surface < 2; ++surface) {
            const Lanes w = KeepLanes(on[surface], count);
            weight[surface][s] += w;
            u[surface][s] += w * m_u;
            v[surface][s] += w * m_v;
            there[surface][s] += w * z_there;
          }
        }
      }
    }
    Surroundings out = {};
    for (int surface = 0; surface < 2; ++surface) {
      out.like[surface] = kNoVote + SumLanes(like[surface]);
      out.akin[surface] = kNoVote + SumLanes(akin[surface]);
      for (int s = 0; s < 2; ++s) {
        const float total = SumLanes(weight[surface][s]);
        if (total > 0)
          out.motion[surface][s] = {total, SumLanes(u[surface][s]) / total, SumLanes(v[surface][s]) / total,
                                    SumLanes(there[surface][s]) / total};
      }
    }
    return out;
  }

  // What each of eight neighbours' word on colour counts.
  Lanes LoadVotes(int x, int y) const {
    typedef uint8_t Bytes __attribute__((vector_size(kLanes)));
    Bytes confirmed;
    std::memcpy(&confirmed, in_.fused->confirmed.row(y) + x, sizeof(confirmed));
    return kUnconfirmedVote + (1 - kUnconfirmedVote) * __builtin_convertvector(confirmed, Lanes);
  }

  // +1 where all eight neighbours lie on the nearer surface, -1 where none does.
  float NeighbourLabel(const SilhouettePixel& pixel) const {
    float near_count = 0, count = 0;
    for (int y = std::max(0, pixel.y - 1); y <= std::min(depth_.height() - 1, pixel.y + 1); ++y)
      for (int x = std::max(0, pixel.x - 1); x <= std::min(depth_.width() - 1, pixel.x + 1); ++x) {
        if (x == pixel.x && y == pixel.y) continue;
        const float z = depth_(x, y);
        near_count += std::abs(z - pixel.near_m) < std::abs(z - pixel.far_m) ? 1.0F : 0.0F;
        ++count;
      }
    return 2 * near_count / count - 1;
  }

  void Weigh(SilhouettePixel& pixel) const {
    const int x = pixel.x, y = pixel.y;
    const auto& [like, akin, motion] = LookAround(pixel);
    auto& evidence = pixel.evidence;
    const float present = pixel.is_near ? 1.0F : -1.0F;
    const Provenance provenance = in_.fused->provenance(x, y);
    if (in_.fused->confirmed(x, y)) evidence[kConfirmed] = present;
    if (provenance == Provenance::kBoth) evidence[kSeenFromBoth] = present;
    if (provenance == Provenance::kOne) evidence[kSeenFromOne] = present;
    evidence[kLikeColors] = std::log(like[0] / like[1]);
    evidence[kAkinColors] = std::log(akin[0] / akin[1]);
    evidence[kColorConstancy] = ColorConstancy(pixel, target_.color(x, y), motion);
    for (int s = 0; s < 2; ++s) {
      const float label = KeyLabel(pixel, s, motion[0][s], motion[1][s]);
      evidence[kKeyLabels] += label;
      evidence[kTimelyKeyLabels] += (s == 0 ? 1 - target_.tau : target_.tau) * label;
    }
    evidence[kNeighbours] = NeighbourLabel(pixel);
    for (const int direction : {-1, 1}) {
      const int s = direction < 0 ? 0 : 1;
      evidence[kNextFrames] += FrameLabel(pixel, direction, motion[0][s]);
      evidence[kSecondFrames] += FrameLabel(pixel, 2 * direction, motion[0][s]);
    }
  }

  // Which part of the way to the key on its side of the target a frame of the window has gone.
  float PartOfWay(const SilhouetteFrame& frame) const {
    if (frame.tau == target_.tau) return 0;
    return frame.tau < target_.tau ? (target_.tau - frame.tau) / target_.tau
                                   : (frame.tau - target_.tau) / (1 - target_.tau);
  }

  // Mean over the window of the colour's change along one surface's motion, less the same along the other's.
  float ColorConstancy(const SilhouettePixel& pixel, Rgb8 color, const SurfaceMotion (&motion)[2][2]) const {
    float sum[2] = {}, count[2] = {};
    for (const SilhouetteFrame& frame : in_.window) {
      if (frame.tau == target_.tau) continue;
      const int s = frame.tau < target_.tau ? 0 : 1;
      const float part = PartOfWay(frame);
      for (int surface = 0; surface < 2; ++surface) {
        const SurfaceMotion& m = motion[surface][s];
        if (m.weight <= 0) continue;
        sum[surface] += std::min(kWorstColor, Difference(color, frame.color, static_cast<float>(pixel.x) + part * m.u,
                                                         static_cast<float>(pixel.y) + part * m.v));
        ++count[surface];
      }
    }
    if (count[0] == 0 || count[1] == 0) return 0;
    return std::clamp(sum[1] / count[1] - sum[0] / count[0], -kMostConstancy, kMostConstancy);
  }

  // Bilinear mean of +1 (near) and -1 (far) around a place; `label` gives 0 where nothing is known.
  template <typename Label>
  static float LabelAt(float x, float y, const Label& label) {
    const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
    const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
    return (1 - ay) * ((1 - ax) * label(x0, y0) + ax * label(x0 + 1, y0)) +
           ay * ((1 - ax) * label(x0, y0 + 1) + ax * label(x0 + 1, y0 + 1));
  }

  float KeyLabel(const SilhouettePixel& pixel, int side, const SurfaceMotion& near, const SurfaceMotion& far) const {
    if (near.weight <= 0) return 0;
    const Key& key = *in_.keys[side];
    const float near_m = near.depth_m, far_m = far.weight > 0 ? far.depth_m : pixel.far_m;
    return LabelAt(static_cast<float>(pixel.x) + near.u, static_cast<float>(pixel.y) + near.v, [&](int x, int y) {
      if (!key.distance.Contains(x, y) || key.distance(x, y) != 0) return 0.0F;
      const float z = key.depth_m(x, y);
      return std::abs(z - near_m) < std::abs(z - far_m) ? 1.0F : -1.0F;
    });
  }

  float FrameLabel(const SilhouettePixel& pixel, int offset, const SurfaceMotion& motion) const {
    const int index = in_.target + offset;
    if (motion.weight <= 0 || index < 0 || index >= static_cast<int>(in_.window.size())) return 0;
    const SilhouetteFrame& frame = in_.window[index];
    if (frame.depth_m.empty()) return 0;
    const float part = PartOfWay(frame);
    return LabelAt(static_cast<float>(pixel.x) + part * motion.u, static_cast<float>(pixel.y) + part * motion.v,
                   [&](int x, int y) {
                     const float z = frame.depth_m.Clamped(x, y);
                     return std::abs(z - pixel.near_m) < std::abs(z - pixel.far_m) ? 1.0F : -1.0F;
                   });
  }

  const SilhouetteInput& in_;
  const SilhouetteFrame& target_;
  const ImageView<const float> depth_;
  const std::array<RowWeights, 2 * kWindowRadius + 1> weights_;
  std::array<Image<float>, 3> color_;  // of the target
};

}  // namespace

std::vector<SilhouettePixel> LookAtSilhouettes(const SilhouetteInput& input) { return Looker(input).Look(); }

Image<uint8_t> SettleSilhouettes(const std::vector<SilhouettePixel>& pixels, const SilhouetteWeights& weights,
                                 ImageView<float> depth_m) {
  Image<uint8_t> changed(depth_m.width(), depth_m.height());
  for (const SilhouettePixel& pixel : pixels) {
    float sum = 0;
    for (int i = 0; i < kEvidenceCount; ++i) sum += weights[i] * pixel.evidence[i];
    if ((sum > 0) == pixel.is_near) continue;
    depth_m(pixel.x, pixel.y) = sum > 0 ? pixel.near_m : pixel.far_m;
    changed(pixel.x, pixel.y) = 1;
  }
  return changed;
}

Image<uint8_t> DecideSilhouettesAsFitted(int color_index, int pass, const std::vector<SilhouettePixel>& pixels,
                                         ImageView<float> depth_m) {
  return SettleSilhouettes(pixels, kSilhouetteWeights[std::min<size_t>(pass, kSilhouetteWeights.size() - 1)], depth_m);
}

}  // namespace depthtween
