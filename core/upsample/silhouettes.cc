#include "core/upsample/silhouettes.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace depthtween {
namespace {

constexpr int kWindowRadius = 6;          // of the neighbours that vote and show how their surface moves
constexpr float kSpaceSigma = 2.5F;       // pixels
constexpr float kLikeSigma = 8.0F;        // sRGB units, over three channels: noise of a camera
constexpr float kAkinSigma = 20.0F;       // shading, texture
constexpr float kUnconfirmedVote = 0.3F;  // of a neighbour whose own surface is not certain
constexpr float kNoVote = 1e-3F;          // keeps the ratio of votes finite
constexpr float kCostScale = 4.0F;        // a motion whose match is worse by this counts 1/e
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

// exp(-d / scale) of squared colour distances and costs, looked up: it is asked for often, and not for its digits.
class Falloff {
 public:
  Falloff(float scale, float step) : per_step_(1 / step) {
    for (size_t i = 0; i < values_.size(); ++i) values_[i] = std::exp(-(static_cast<float>(i) + 0.5F) * step / scale);
    values_.back() = 0;
  }
  float operator()(float d) const { return values_[std::min(static_cast<size_t>(d * per_step_), values_.size() - 1)]; }

 private:
  float per_step_;
  std::array<float, 1024> values_;
};

struct Neighbour {
  int dx, dy;
  float weight;
};
std::vector<Neighbour> Neighbours() {
  std::vector<Neighbour> out;
  for (int dy = -kWindowRadius; dy <= kWindowRadius; ++dy)
    for (int dx = -kWindowRadius; dx <= kWindowRadius; ++dx)
      if (dx != 0 || dy != 0)
        out.push_back({dx, dy, std::exp(static_cast<float>(-dx * dx - dy * dy) / (2 * kSpaceSigma * kSpaceSigma))});
  return out;
}

// Mean motion of a surface around a pixel to a key, and its depth there.
struct SurfaceMotion {
  float weight = 0, u = 0, v = 0, depth_m = 0;
};

class Looker {
 public:
  explicit Looker(const SilhouetteInput& input)
      : in_(input), target_(input.window[input.target]), depth_(target_.depth_m), neighbours_(Neighbours()) {}

  std::vector<SilhouettePixel> Look() const {
    std::vector<SilhouettePixel> out;
    for (int y = 0; y < depth_.height(); ++y)
      for (int x = 0; x < depth_.width(); ++x)
        if (std::optional<SilhouettePixel> pixel = BesideJump(x, y)) {
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

  void Weigh(SilhouettePixel& pixel) const {
    const int x = pixel.x, y = pixel.y;
    const auto is_near = [&](float z) { return std::abs(z - pixel.near_m) < std::abs(z - pixel.far_m); };
    const Rgb8 color = target_.color(x, y);
    SurfaceMotion motion[2][2];  // [near, far][key]
    float like[2] = {kNoVote, kNoVote}, akin[2] = {kNoVote, kNoVote};
    float near_count = 0, count = 0;
    for (const auto& [dx, dy, weight] : neighbours_) {
      const int nx = x + dx, ny = y + dy;
      if (!depth_.Contains(nx, ny)) continue;
      const float z = depth_(nx, ny);
      const int surface = is_near(z) ? 0 : 1;
      if (std::abs(dx) <= 1 && std::abs(dy) <= 1) near_count += static_cast<float>(1 - surface), ++count;
      if (!Same(z, surface == 0 ? pixel.near_m : pixel.far_m)) continue;
      for (int s = 0; s < 2; ++s) {
        const SideChoice& side = in_.choice->sides[s];
        const float there = side.depth_m(nx, ny);
        if (std::abs(there - z) > kDepthMoves * z) continue;
        const float w = weight * by_cost_(side.cost(nx, ny));
        const Flow2 m = side.motion(nx, ny);
        SurfaceMotion& mean = motion[surface][s];
        mean.weight += w, mean.u += w * m.u, mean.v += w * m.v, mean.depth_m += w * there;
      }
      const Rgb8 other = target_.color(nx, ny);
      const float r = static_cast<float>(color.r) - static_cast<float>(other.r);
      const float g = static_cast<float>(color.g) - static_cast<float>(other.g);
      const float b = static_cast<float>(color.b) - static_cast<float>(other.b);
      const float distance = r * r + g * g + b * b;
      const float vote = weight * (in_.fused->confirmed(nx, ny) ? 1.0F : kUnconfirmedVote);
      like[surface] += vote * by_like_(distance);
      akin[surface] += vote * by_akin_(distance);
    }
    for (auto& surface : motion)
      for (SurfaceMotion& m : surface)
        if (m.weight > 0) m.u /= m.weight, m.v /= m.weight, m.depth_m /= m.weight;

    auto& evidence = pixel.evidence;
    const float present = pixel.is_near ? 1.0F : -1.0F;
    const Provenance provenance = in_.fused->provenance(x, y);
    if (in_.fused->confirmed(x, y)) evidence[kConfirmed] = present;
    if (provenance == Provenance::kBoth) evidence[kSeenFromBoth] = present;
    if (provenance == Provenance::kOne) evidence[kSeenFromOne] = present;
    evidence[kLikeColors] = std::log(like[0] / like[1]);
    evidence[kAkinColors] = std::log(akin[0] / akin[1]);
    evidence[kColorConstancy] = ColorConstancy(pixel, color, motion);
    for (int s = 0; s < 2; ++s) evidence[kKeyLabels] += KeyLabel(pixel, s, motion[0][s], motion[1][s]);
    evidence[kNeighbours] = count > 0 ? 2 * near_count / count - 1 : 0;
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
  const std::vector<Neighbour> neighbours_;
  const Falloff by_cost_{kCostScale, 0.1F};
  const Falloff by_like_{2 * kLikeSigma * kLikeSigma, 1.0F};
  const Falloff by_akin_{2 * kAkinSigma * kAkinSigma, 8.0F};
};

}  // namespace

std::vector<SilhouettePixel> LookAtSilhouettes(const SilhouetteInput& input) { return Looker(input).Look(); }

void SettleSilhouettes(const std::vector<SilhouettePixel>& pixels, ImageView<float> depth_m) {
  for (const SilhouettePixel& pixel : pixels) {
    float sum = 0;
    for (int i = 0; i < kEvidenceCount; ++i) sum += kSilhouetteWeights[i] * pixel.evidence[i];
    if ((sum > 0) != pixel.is_near) depth_m(pixel.x, pixel.y) = sum > 0 ? pixel.near_m : pixel.far_m;
  }
}

}  // namespace depthtween
