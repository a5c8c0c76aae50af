#include "core/io/image_limits.h"

#include "absl/strings/str_format.h"

namespace depthtween {

absl::Status ImageLimits::Check(int64_t width, int64_t height) const {
  if (width < 1 || height < 1)
    return absl::InvalidArgumentError(
        absl::StrFormat("image is %d x %d pixels, must have at least one each way", width, height));
  if (width > max_side || height > max_side)
    return absl::ResourceExhaustedError(absl::StrFormat(
        "image is %d x %d pixels, at most %d are allowed on a side: scale it down", width, height, max_side));
  if (width * height > max_pixels)
    return absl::ResourceExhaustedError(absl::StrFormat(
        "image is %d x %d pixels, at most %d are allowed in all: scale it down", width, height, max_pixels));
  return absl::OkStatus();
}

}  // namespace depthtween
