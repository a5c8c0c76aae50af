// For each pixel of a target frame: where it lies in a key, chosen among proposals by how well the observed colours
// match.
//
// Shapes:   all images W x H.  Units: pixels, metres, costs in sRGB units (see match.h).
// Threads:  Choose splits rows over `threads`; results do not depend on it.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_CHOOSE_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_CHOOSE_H_

#include <array>
#include <vector>

#include "core/base/image.h"
#include "core/fill/depth_noise.h"
#include "core/upsample/keys.h"
#include "core/upsample/match.h"

namespace depthtween {

// Two keys, before [0] and after [1] the target frame. Without the second (null) only the first side is chosen, and the
// images of the other stay zero.
struct ChooseInput {
  const MatchImage* target = nullptr;
  std::array<const Key*, 2> keys = {};
  // Proposed motions target -> key. The first is evaluated everywhere, the others where the match is uncertain.
  std::array<std::vector<ImageView<const Flow2>>, 2> proposals;
  // Of these, one that is not (0, 0) is compared with the first however certain that is. May be empty.
  std::array<ImageView<const Flow2>, 2> thin;
  float tau = 0.5F;  // the target's time between the keys, 0..1
  DepthNoise noise;
};

struct ChooseOptions {
  int sweeps = 2;
};

struct SideChoice {
  Image<Flow2> motion;   // target -> key
  Image<float> cost;     // of that motion, with its penalties
  Image<float> depth_m;  // of the key at the end of that motion
};

struct Choice {
  std::array<SideChoice, 2> sides;
  Image<uint8_t> uncertain;  // 1 where proposals were compared
};

Choice Choose(const ChooseInput& input, const ChooseOptions& options, int threads);

// Depth of `key` at a sub-pixel place: bilinear among the neighbours in the layer of the nearest pixel. Clamped to the
// image.
float SampleDepthInLayer(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise);

// 1 within `radius` pixels of a depth jump (neighbouring pixels of different layers).
Image<uint8_t> NearDepthJumps(ImageView<const float> depth_m, int radius, const DepthNoise& noise, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_CHOOSE_H_
