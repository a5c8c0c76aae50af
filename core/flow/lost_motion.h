// Motion of small, fast things, which coarse-to-fine flow loses: at the scale where their motion is a pixel they are
// hardly a pixel themselves.
//
// Where the flows a->b and b->a both leave colours unexplained, something moved that neither found. Windows there are
// matched by exhaustive search against the unexplained places of the other frame. Pixels around a matched window take
// its motion where that explains them better than their flow does and the forward-backward check confirms it.
//
// Shapes:   all images W x H.  Units: pixels; luma 0..255.
// Threads:  safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_FLOW_LOST_MOTION_H_
#define DEPTHTWEEN_CORE_FLOW_LOST_MOTION_H_

#include "core/base/image.h"

namespace depthtween {

// Search range at full resolution, pixels to each side; twice as far at half resolution, and so on.
inline constexpr int kLostMotionReach = 24;

struct LostMotionOptions {
  int scales = 1;  // resolutions, from the coarsest to the full one. >= 1
  // Ratio test: the difference of any other place, but for those beside the best one, must be at least this many times
  // the best one's. >= 1. Above 1, a repeating pattern is not matched to its own repetition.
  float distinct = 1.0F;
};

// Corrects the flows a->b and b->a, all of one size; true if anything changed. Skips a resolution where a side of the
// images is below 2 kLostMotionReach, or where more than kLostMotionShare of either frame is unexplained: a cut or a
// change of light is no motion.
inline constexpr float kLostMotionShare = 0.15F;
bool RecoverLostMotion(ImageView<const uint8_t> a, ImageView<const uint8_t> b, Image<Flow2>& ab, Image<Flow2>& ba,
                       const LostMotionOptions& options = {});

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FLOW_LOST_MOTION_H_
