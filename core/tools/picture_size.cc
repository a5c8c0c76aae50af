#include "core/tools/picture_size.h"

#include <cstdio>

#include "absl/strings/str_format.h"

namespace depthtween::tools {

absl::Status ParsePictureSize(const std::string& text, int& width, int& height) {
  int used = 0;
  if (std::sscanf(text.c_str(), "%5dx%5d%n", &width, &height, &used) != 2 || used != static_cast<int>(text.size()))
    return absl::InvalidArgumentError(
        absl::StrFormat("--size = '%s', must be width x height in pixels, such as 512x424", text));
  return absl::OkStatus();
}

}  // namespace depthtween::tools
