// PNG <-> images. Lossless: what Encode takes, Decode gives back bit for bit.
//
// Errors:   DataLoss: not a PNG, cut short, a wrong checksum (of a chunk that pixels depend on). ResourceExhausted:
// over a limit, found in the header before any
//           pixel is allocated. InvalidArgument: another kind of pixel than asked for, with what was found.
//           Read and Write add the path and what the file system says.
// Threads:  safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_IO_PNG_H_
#define DEPTHTWEEN_CORE_IO_PNG_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/io/image_limits.h"

namespace depthtween {

// 48-bit colour: KITTI stores flow in it.
struct Rgb16 {
  uint16_t r = 0, g = 0, b = 0;
  friend bool operator==(const Rgb16& a, const Rgb16& c) { return a.r == c.r && a.g == c.g && a.b == c.b; }
};

// Whether the bytes begin with PNG's signature.
bool LooksLikePng(std::string_view bytes);

// 16-bit grey only: the values are measurements, so nothing is converted.
absl::StatusOr<Image<uint16_t>> DecodePng16(std::string_view bytes, const ImageLimits& limits = {});
// 8-bit grey only.
absl::StatusOr<Image<uint8_t>> DecodePng8(std::string_view bytes, const ImageLimits& limits = {});
// 16-bit RGB only.
absl::StatusOr<Image<Rgb16>> DecodePngRgb16(std::string_view bytes, const ImageLimits& limits = {});
// Any PNG as 8-bit colour: grey is repeated, palettes are looked up, 16 bits are scaled to 8, alpha is dropped.
absl::StatusOr<Image<Rgb8>> DecodePngRgb8(std::string_view bytes, const ImageLimits& limits = {});

// zlib's scale: 0 stores, 1 is fast, 9 is small. On the depth of a 512 x 424 sensor 3 takes half as long again as 1 and
// saves 1 % of the bytes.
inline constexpr int kDefaultPngCompression = 1;

// InvalidArgument when the image is empty, or for a compression outside 0..9.
absl::StatusOr<std::string> EncodePng16(ImageView<const uint16_t> image, int compression = kDefaultPngCompression);
absl::StatusOr<std::string> EncodePng8(ImageView<const uint8_t> image, int compression = kDefaultPngCompression);
absl::StatusOr<std::string> EncodePngRgb8(ImageView<const Rgb8> image, int compression = kDefaultPngCompression);
absl::StatusOr<std::string> EncodePngRgb16(ImageView<const Rgb16> image, int compression = kDefaultPngCompression);

absl::StatusOr<Image<uint16_t>> ReadPng16(const std::string& path, const ImageLimits& limits = {});
absl::StatusOr<Image<uint8_t>> ReadPng8(const std::string& path, const ImageLimits& limits = {});

// Whole or not at all, as WriteFile in core/io/file.h.
absl::Status WritePng16(const std::string& path, ImageView<const uint16_t> image);
absl::Status WritePng8(const std::string& path, ImageView<const uint8_t> image);
absl::Status WritePngRgb8(const std::string& path, ImageView<const Rgb8> image);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_PNG_H_
