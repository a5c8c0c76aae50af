// One depth per target pixel from what the two keys say.
//
// Shapes:   all images W x H.  Units: metres; tau in [0, 1].
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_FUSE_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_FUSE_H_

#include <vector>

#include "core/fill/weighted_median.h"
#include "core/sequence/depth_result.h"
#include "core/upsample/choose.h"

namespace depthtween {

// A match worse by this, in sRGB units, has 1/e of the confidence.
constexpr float kCostScale = 4.0F;
// Answers further apart than this share of the depth are about two surfaces, unless the surface is seen to grow or
// shrink as one does that comes so much nearer or goes so much farther away.
constexpr float kOneSurface = 0.20F;

struct Fused {
  Image<float> depth_m;     // 0 = unknown
  Image<float> change_m;    // from the first key's answer to the second one's; 0 where only one answers
  Image<float> confidence;  // of the vote in the weighted median, 0..1
  Image<Provenance> provenance;
  Image<uint8_t> confirmed;  // 1 where both keys measured it and agree: no vote of neighbours can know better
  Image<uint8_t> travelled;  // 1 where one surface has changed its depth by more than kOneSurface
};

// Where the sides agree: their mean, weighted by match and closeness in time, after each has gone its share of the way
// that the surface moves in depth, linear in time, as neighbours in its layer tell it. Where they differ moderately and
// match equally well, or neighbours change alike: linear in time. Otherwise: the better match, going that way. With one
// side: what it says.
Fused Fuse(const ChooseInput& input, const Choice& choice, int threads);

// Fused depth, near jumps settled by the median along colour of `radius` pixels (0: left as it is), in which other
// frames vote as well. Confirmed pixels stay.
Image<float> MedianNearJumps(const Fused& fused, ImageView<const Rgb8> color,
                             const std::vector<MedianWitness>& witnesses, int radius, const DepthNoise& noise,
                             int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_FUSE_H_
