// Depth maps that were resampled with unknown taken for zero: their pixels beside unknown ones are mixtures with zero,
// far too near, and would flood every hole and border that is filled from them.
//
// Units: metres along z, 0 = unknown.
#ifndef DEPTHTWEEN_CORE_FILL_MIXED_RIM_H_
#define DEPTHTWEEN_CORE_FILL_MIXED_RIM_H_

#include <cstdint>

#include "core/base/image.h"

namespace depthtween {

// Sets such pixels to 0 and returns their number. They are those beside unknown ones that no measurement farther inside
// supports: all of these lie in layers behind. A sensor returns hardly any, such a resampling makes nearly all
// pixels beside unknown ones so: a depth map with few keeps them.
int64_t DropMixedRim(Image<float>& depth_m);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FILL_MIXED_RIM_H_
