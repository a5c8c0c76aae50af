// Colour frames, whichever of the accepted formats they are in.
#ifndef DEPTHTWEEN_CORE_IO_COLOR_H_
#define DEPTHTWEEN_CORE_IO_COLOR_H_

#include <string>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/io/image_limits.h"

namespace depthtween {

// PNG or JPEG, told apart by their first bytes and not by the file's name. InvalidArgument when it is neither, saying
// what it is, and when EXIF says that its pixels are to be turned; else as DecodePngRgb8 and DecodeJpeg.
absl::StatusOr<Image<Rgb8>> DecodeColor(std::string_view bytes, const ImageLimits& limits = {});
absl::StatusOr<Image<Rgb8>> ReadColor(const std::string& path, const ImageLimits& limits = {});

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_COLOR_H_
