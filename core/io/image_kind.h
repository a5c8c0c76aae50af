// What a file is, by its first bytes and not by its name, and what to do with one that is not read here.
#ifndef DEPTHTWEEN_CORE_IO_IMAGE_KIND_H_
#define DEPTHTWEEN_CORE_IO_IMAGE_KIND_H_

#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween {

// "a TIFF image", "an OpenEXR image", "a NumPy array", ...: formats that people store frames in, and what stands in a
// frame's place when a download failed. Empty when it is none of them.
std::string_view ImageKind(std::string_view bytes);

// InvalidArgument that names what the bytes are and how to convert it to what colour, or depth, must be.
absl::Status NotAColorImage(std::string_view bytes);
absl::Status NotADepthImage(std::string_view bytes);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_IMAGE_KIND_H_
