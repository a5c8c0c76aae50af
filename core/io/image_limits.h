// How large an image a decoder agrees to hold, decided from its header before a byte of pixels is allocated.
#ifndef DEPTHTWEEN_CORE_IO_IMAGE_LIMITS_H_
#define DEPTHTWEEN_CORE_IO_IMAGE_LIMITS_H_

#include <cstdint>

#include "core/base/status.h"

namespace depthtween {

struct ImageLimits {
  int64_t max_pixels = 64'000'000;  // 64 megapixels, as for cameras
  int64_t max_side = 32768;         // pixels

  // ResourceExhausted when an image of this size is over a limit, InvalidArgument when it has no pixels.
  absl::Status Check(int64_t width, int64_t height) const;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_IMAGE_LIMITS_H_
