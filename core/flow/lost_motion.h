// Motion of small, fast things, which coarse-to-fine flow loses: at the scale where their motion is a pixel they are
// hardly one pixel themselves.
//
// Where the flows a->b and b->a both leave colours unexplained, something moved that neither found. Windows of such
// places are looked for exhaustively among the other frame's such places; pixels around a window that was found take
// its motion where that explains them better than their flow, and where the way back confirms it.
//
// Shapes:   all images W x H.  Units: pixels; luma 0..255.
// Threads:  safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_FLOW_LOST_MOTION_H_
#define DEPTHTWEEN_CORE_FLOW_LOST_MOTION_H_

#include "core/base/image.h"

namespace depthtween {

// How far a window is looked for at full resolution, pixels to each side; twice as far at half resolution, and so on.
inline constexpr int kLostMotionReach = 24;

struct LostMotionOptions {
  int scales = 1;  // resolutions, from the coarsest to the full one. >= 1
  // How much worse than the best place any other must be, not counting those beside it: a factor on differences, >= 1.
  // Above 1, a pattern that repeats is not found where it never went.
  float distinct = 1.0F;
};

// Mends the flows a->b and b->a, all of one size, and says whether anything changed. A resolution is left out where
// images have less than 2 kLostMotionReach to a side, or where more than kLostMotionShare of either frame is
// unexplained: a cut or a change of light is no motion.
inline constexpr float kLostMotionShare = 0.15F;
bool RecoverLostMotion(ImageView<const uint8_t> a, ImageView<const uint8_t> b, Image<Flow2>& ab, Image<Flow2>& ba,
                       const LostMotionOptions& options = {});

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FLOW_LOST_MOTION_H_
