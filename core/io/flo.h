// Optical flow and single planes as plain floats: Middlebury's .flo and the portable float map (.pfm).
//
// Errors:   DataLoss for damaged bytes; ResourceExhausted over a limit. Write adds what the file system says.
// Threads:  safe to call concurrently.
// Source:   vision.middlebury.edu/flow (.flo: "PIEH", width, height, then u, v by rows, little endian); .pfm: "Pf",
//           width height, negative scale for little endian, then rows from the bottom up.
#ifndef DEPTHTWEEN_CORE_IO_FLO_H_
#define DEPTHTWEEN_CORE_IO_FLO_H_

#include <string>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/io/image_limits.h"

namespace depthtween {

std::string EncodeFlo(ImageView<const Flow2> flow);
absl::StatusOr<Image<Flow2>> DecodeFlo(std::string_view bytes, const ImageLimits& limits = {});
absl::Status WriteFlo(const std::string& path, ImageView<const Flow2> flow);

std::string EncodePfm(ImageView<const float> image);
absl::StatusOr<Image<float>> DecodePfm(std::string_view bytes, const ImageLimits& limits = {});
absl::Status WritePfm(const std::string& path, ImageView<const float> image);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_FLO_H_
