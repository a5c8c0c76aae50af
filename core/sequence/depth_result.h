// What the upsampler says of one colour frame, on the grid of the input colour image.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_DEPTH_RESULT_H_
#define DEPTHTWEEN_CORE_SEQUENCE_DEPTH_RESULT_H_

#include <cstdint>

#include "core/base/image.h"

namespace depthtween {

// Where a pixel's depth comes from. Values are those of the provenance PNGs.
enum class Provenance : uint8_t {
  kNone = 0,      // no answer: depth 0
  kMeasured = 1,  // this frame coincides with a depth frame, and the sensor saw this pixel
  kBoth = 2,      // seen from the depth frames before and after
  kOne = 3,       // seen from one of them
  kInferred = 4,  // seen from neither: filled from the same layer
  kHeld = 5,      // before the first or after the last depth frame: that frame, unmoved
};

struct DepthResult {
  int color_index = -1;  // into Sequence::color
  Image<float> depth_m;  // metres, 0 = unknown
  Image<float> sigma_m;  // predicted standard deviation, metres; 0 where depth is unknown
  Image<Provenance> provenance;
  // Flow to the next colour frame, and from there back to this one. Empty unless asked for, on frames that are
  // held, and in causal mode.
  Image<Flow2> motion_next, motion_back;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_DEPTH_RESULT_H_
