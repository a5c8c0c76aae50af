// The width and height of pictures as people write them.
#ifndef DEPTHTWEEN_CORE_TOOLS_PICTURE_SIZE_H_
#define DEPTHTWEEN_CORE_TOOLS_PICTURE_SIZE_H_

#include <string>

#include "core/base/status.h"

namespace depthtween::tools {

// "WxH" into width and height; InvalidArgument about --size otherwise. Whether they make sense is for others to say.
absl::Status ParsePictureSize(const std::string& text, int& width, int& height);

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_PICTURE_SIZE_H_
