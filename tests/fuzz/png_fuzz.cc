// Any bytes as a PNG: a status or an image within the limits, and what was decoded encodes and decodes to itself.
#include "core/io/png.h"

#include <cstdlib>
#include <cstring>

#include "core/io/exif.h"
#include "core/io/image_kind.h"

using namespace depthtween;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const int orientation = ExifOrientation(bytes);
  if (orientation < 1 || orientation > 8 || NotADepthImage(bytes).ok()) std::abort();
  const ImageLimits limits = {.max_pixels = 1 << 16, .max_side = 4096};
  if (const auto color = DecodePngRgb8(bytes, limits); color.ok()) {
    if (color->pixel_count() > static_cast<size_t>(limits.max_pixels)) std::abort();
  }
  if (const auto grey = DecodePng16(bytes, limits); grey.ok()) {
    const auto again = DecodePng16(*EncodePng16(*grey));
    if (!again.ok() || std::memcmp(again->data(), grey->data(), grey->pixel_count() * 2) != 0) std::abort();
  }
  return 0;
}
