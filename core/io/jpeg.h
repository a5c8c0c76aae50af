// JPEG <-> colour images.
//
// Errors:   DataLoss: not a JPEG, cut short, or damaged (a decoder's warning counts as damage, since it
//           would invent pixels; but for odd headers, and a few stray bytes between the last pixel and the end).
//           ResourceExhausted: over a limit, found in the header. InvalidArgument: CMYK, 12 bits per
//           sample, lossless or arithmetic coding.
// Threads:  safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_IO_JPEG_H_
#define DEPTHTWEEN_CORE_IO_JPEG_H_

#include <string>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/io/image_limits.h"

namespace depthtween {

inline constexpr int kDefaultJpegQuality = 95;

// Whether the bytes begin with JPEG's signature.
bool LooksLikeJpeg(std::string_view bytes);

// Grey and colour, baseline and progressive. The accurate integer DCT, so that every machine decodes the same bits.
absl::StatusOr<Image<Rgb8>> DecodeJpeg(std::string_view bytes, const ImageLimits& limits = {});

// 4:4:4: colour edges stay where they are, which depth is aligned to. `quality` is libjpeg's, 1..100; InvalidArgument
// outside it, or when the image is empty.
absl::StatusOr<std::string> EncodeJpeg(ImageView<const Rgb8> image, int quality = kDefaultJpegQuality);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_JPEG_H_
