// Optical flow as KITTI stores it: 16-bit RGB PNG, u = (R - 2^15) / 64, v = (G - 2^15) / 64, B = valid.
#ifndef DEPTHTWEEN_CORE_IO_FLOW_PNG_H_
#define DEPTHTWEEN_CORE_IO_FLOW_PNG_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/io/image_limits.h"

namespace depthtween {

struct FlowField {
  Image<Flow2> flow;     // pixels; 0 where not valid
  Image<uint8_t> valid;  // 1 or 0
};

// Rounds to 1/64 px. A displacement that does not fit +-511 px is stored as not valid. InvalidArgument when sizes
// differ.
absl::StatusOr<std::string> EncodeFlowPng(ImageView<const Flow2> flow, ImageView<const uint8_t> valid);
// Errors as DecodePngRgb16.
absl::StatusOr<FlowField> DecodeFlowPng(std::string_view bytes, const ImageLimits& limits = {});

absl::Status WriteFlowPng(const std::string& path, ImageView<const Flow2> flow, ImageView<const uint8_t> valid);
absl::StatusOr<FlowField> ReadFlowPng(const std::string& path, const ImageLimits& limits = {});

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_FLOW_PNG_H_
