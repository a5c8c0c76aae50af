// On which of its two surfaces does a pixel beside a silhouette lie? Weighs what the colours around it, the other
// frames and the measurements of both keys say, once following the motion of the nearer surface and once that of the
// farther.
//
// Nearly all squared error of an upsampled depth map lies one pixel beside a depth jump, where the map's own neighbours
// and the window of a match see both surfaces. What tells them apart is time: followed along the right surface's motion
// a pixel keeps its colour through the interval, and the keys that measured that surface there agree. Each such fact
// alone errs often; a linear decision with weights fitted by logistic regression on the library's scenes
// (tests/bench/silhouette_fit) errs less than any.
//
// Shapes:   all images W x H.  Units: metres, pixels, sRGB; tau: time between the keys, 0..1.
// Threads:  safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_SILHOUETTES_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_SILHOUETTES_H_

#include <array>
#include <functional>
#include <vector>

#include "core/base/image.h"
#include "core/upsample/choose.h"
#include "core/upsample/fuse.h"

namespace depthtween {

// A colour frame of the window, with the depth found for it (settled by the median), if it has any.
struct SilhouetteFrame {
  float tau = 0;
  ImageView<const Rgb8> color;
  ImageView<const float> depth_m = {};
};

struct SilhouetteInput {
  std::vector<SilhouetteFrame> window;  // in time order
  int target = 0;                       // the frame of the window to look at; it has depth
  const Fused* fused = nullptr;         // of the target
  const Choice* choice = nullptr;       // of the target
  std::array<const Key*, 2> keys = {};  // before [0] and after [1]
  DepthNoise noise;
  // Not 0 where the pass before changed the target's depth: only pixels near such ones are looked at again. Empty in
  // the first pass, which looks at all.
  ImageView<const uint8_t> changed = {};
};

// What speaks for the nearer surface (positive) or the farther (negative). The first three say how sure the present
// answer is, the others where the pixel belongs.
enum SilhouetteEvidence : int {
  kConfirmed,        // the present answer, where both keys measured it and agree
  kSeenFromBoth,     // the present answer, where its provenance is kBoth ...
  kSeenFromOne,      // ... or kOne
  kLikeColors,       // log ratio of the neighbours on either surface whose colour is like the pixel's within noise, ...
  kAkinColors,       // ... and within shading
  kColorConstancy,   // how much better the colour keeps along the nearer surface's motion than along the farther's
  kKeyLabels,        // what the keys measured where the nearer surface's motion leads, ...
  kTimelyKeyLabels,  // ... and the same, each key by how near in time it is
  kNeighbours,       // how many of the eight neighbours lie on the nearer surface
  kNextFrames,       // on which surface the next frames see it, along the nearer surface's motion, ...
  kSecondFrames,     // ... and those after them
  kEvidenceCount
};

using SilhouetteWeights = std::array<float, kEvidenceCount>;

// Of the first pass, and of those after it, which see what the one before decided. Fitted by tests/bench/silhouette_fit
// on the library's scenes.
inline constexpr std::array<SilhouetteWeights, 2> kSilhouetteWeights = {{
    {-0.70F, 0.82F, 0.32F, 0.27F, 0.17F, 0.10F, 0.40F, 0.60F, 1.57F, 0.30F, 0.37F},
    {-0.30F, 0.62F, 0.20F, 0.25F, 0.21F, 0.05F, 0.01F, 0.99F, 1.04F, 0.36F, 0.15F},
}};

// A pixel with a neighbour (of four) in another layer.
struct SilhouettePixel {
  int x = 0, y = 0;
  float near_m = 0, far_m = 0;  // the depths that it may have; one of them is the present one
  bool is_near = false;         // the present answer
  std::array<float, kEvidenceCount> evidence = {};
};

// Images narrower than 16 pixels have none that could be decided.
std::vector<SilhouettePixel> LookAtSilhouettes(const SilhouetteInput& input);

// Gives each pixel the depth that its evidence speaks for. Returns 1 where that is another than before.
Image<uint8_t> SettleSilhouettes(const std::vector<SilhouettePixel>& pixels, const SilhouetteWeights& weights,
                                 ImageView<float> depth_m);

// Decides the pixels of colour frame `color_index` (into Sequence::color) in pass 0, 1, ..., as SettleSilhouettes does.
// Called from several threads.
using SilhouetteDecision = std::function<Image<uint8_t>(
    int color_index, int pass, const std::vector<SilhouettePixel>& pixels, ImageView<float> depth_m)>;
// By kSilhouetteWeights.
Image<uint8_t> DecideSilhouettesAsFitted(int color_index, int pass, const std::vector<SilhouettePixel>& pixels,
                                         ImageView<float> depth_m);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_SILHOUETTES_H_
