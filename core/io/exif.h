// The one thing in EXIF that matters here: whether viewers turn a picture before they show it.
#ifndef DEPTHTWEEN_CORE_IO_EXIF_H_
#define DEPTHTWEEN_CORE_IO_EXIF_H_

#include <string_view>

#include "core/base/status.h"

namespace depthtween {

// The orientation, 1 (as stored) to 8, in a JPEG's APP1 segment or a PNG's eXIf chunk. 1 when there is none, or what is
// there is no EXIF: a damaged tag turns nothing. Source: EXIF 2.32, 4.6.4 (tag 0x0112), and TIFF 6.0, section 2.
int ExifOrientation(std::string_view image);

// OK when pixels are as stored; else InvalidArgument that says how the picture is to be turned and what to do. Depth
// lies on pixels, and nobody can know whether on those before or after the turn.
absl::Status CheckOrientation(std::string_view image);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_EXIF_H_
