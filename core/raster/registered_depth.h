// A depth map moved to where colour sees it.
#ifndef DEPTHTWEEN_CORE_RASTER_REGISTERED_DEPTH_H_
#define DEPTHTWEEN_CORE_RASTER_REGISTERED_DEPTH_H_

#include "core/base/image.h"
#include "core/sequence/registration.h"

namespace depthtween {

// `depth_m` (metres, 0 = unknown) as the colour camera sees it: surfaces are drawn with a z-buffer, torn at depth
// jumps. What only colour sees, and about a pixel beside each jump, is unknown. Same size. Threads: pure.
Image<float> RegisterDepth(ImageView<const float> depth_m, const Registration& registration);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RASTER_REGISTERED_DEPTH_H_
