#include "core/io/color.h"

#include "core/io/exif.h"
#include "core/io/file.h"
#include "core/io/image_kind.h"
#include "core/io/jpeg.h"
#include "core/io/png.h"

namespace depthtween {

absl::StatusOr<Image<Rgb8>> DecodeColor(std::string_view bytes, const ImageLimits& limits) {
  if (bytes.empty()) return absl::DataLossError("the file is empty");
  RETURN_IF_ERROR(CheckOrientation(bytes));
  if (LooksLikePng(bytes)) return DecodePngRgb8(bytes, limits);
  if (LooksLikeJpeg(bytes)) return DecodeJpeg(bytes, limits);
  return NotAColorImage(bytes);
}

absl::StatusOr<Image<Rgb8>> ReadColor(const std::string& path, const ImageLimits& limits) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path));
  absl::StatusOr<Image<Rgb8>> image = DecodeColor(bytes, limits);
  if (!image.ok()) return WithContext(image.status(), path);
  return image;
}

}  // namespace depthtween
