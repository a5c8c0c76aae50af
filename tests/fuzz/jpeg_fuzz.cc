// Any bytes as a JPEG: a status or an image within the limits, and an orientation that there is.
#include "core/io/jpeg.h"

#include <cstdlib>

#include "core/io/exif.h"

using namespace depthtween;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const int orientation = ExifOrientation({reinterpret_cast<const char*>(data), size});
  if (orientation < 1 || orientation > 8) std::abort();
  const ImageLimits limits = {.max_pixels = 1 << 14, .max_side = 1024};
  const auto color = DecodeJpeg({reinterpret_cast<const char*>(data), size}, limits);
  if (color.ok() && color->pixel_count() > static_cast<size_t>(limits.max_pixels)) std::abort();
  return 0;
}
