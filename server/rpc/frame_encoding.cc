#include "server/rpc/frame_encoding.h"

#include <zstd.h>

#include <bit>
#include <cstring>
#include <limits>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/io/jpeg.h"
#include "core/io/png.h"
#include "core/io/quantise.h"

namespace depthtween::server {
namespace {

static_assert(std::endian::native == std::endian::little, "the raw encodings are little-endian");

// Fast, and within 2 % of level 3's size on noisy 16-bit depth.
constexpr int kZstdLevel = 1;
constexpr int64_t kArchiveHeadBytes = 8192;  // of an NPZ with a handful of arrays, with room

template <typename T>
std::string PixelBytes(const Image<T>& image) {
  return {reinterpret_cast<const char*>(image.data()), image.pixel_count() * sizeof(T)};
}

absl::StatusOr<std::string> RawIntegers(const std::string& png, OutputKind kind) {
  if (kind == OutputKind::kProvenance) {
    ASSIGN_OR_RETURN(const Image<uint8_t> image, DecodePng8(png));
    return PixelBytes(image);
  }
  ASSIGN_OR_RETURN(const Image<uint16_t> image, DecodePng16(png));
  return PixelBytes(image);
}

absl::StatusOr<std::string> Metres(const std::string& png, OutputKind kind, double units_per_metre) {
  ASSIGN_OR_RETURN(const Image<uint16_t> units, DecodePng16(png));
  if (kind == OutputKind::kDepth) return PixelBytes(DequantiseDepth(units, units_per_metre));
  Image<float> sigma_m = DequantiseSigma(units, units_per_metre);
  // On the wire an unknown uncertainty is infinite, so that weights of 1/sigma need no special case.
  for (size_t i = 0; i < units.pixel_count(); ++i) {
    if (units.data()[i] == kUnknownSigmaUnits) sigma_m.data()[i] = std::numeric_limits<float>::infinity();
  }
  return PixelBytes(sigma_m);
}

absl::StatusOr<std::string> Compress(const std::string& bytes) {
  std::string compressed(ZSTD_compressBound(bytes.size()), '\0');
  const size_t size = ZSTD_compress(compressed.data(), compressed.size(), bytes.data(), bytes.size(), kZstdLevel);
  if (ZSTD_isError(size) != 0) {
    return absl::InternalError(absl::StrFormat("zstd failed: %s", ZSTD_getErrorName(size)));
  }
  compressed.resize(size);
  return compressed;
}

}  // namespace

std::vector<v1::Encoding> EncodingsOf(const OutputSpec& output) {
  switch (output.kind) {
    case OutputKind::kDepth:
    case OutputKind::kUncertainty:
      return {v1::ENCODING_PNG, v1::ENCODING_RAW, v1::ENCODING_RAW_ZSTD, v1::ENCODING_F32, v1::ENCODING_F32_ZSTD};
    case OutputKind::kProvenance:
      return {v1::ENCODING_PNG, v1::ENCODING_RAW, v1::ENCODING_RAW_ZSTD};
    case OutputKind::kPictures:
      if (output.extension == "jpg") return {v1::ENCODING_JPEG};
      return {v1::ENCODING_PNG, v1::ENCODING_JPEG};
    case OutputKind::kSceneFlow:
      if (output.extension == "flo") return {v1::ENCODING_FLO};
      if (output.extension == "pfm") return {v1::ENCODING_PFM};
      return {output.extension == "npz" ? v1::ENCODING_NPZ : v1::ENCODING_PNG};
    default:
      return {};
  }
}

uint32_t InvalidValueOf(OutputKind kind) {
  return kind == OutputKind::kUncertainty ? kUnknownSigmaUnits : kUnknownDepthUnits;
}

absl::StatusOr<std::string> EncodeFrame(std::string stored, const OutputSpec& output, v1::Encoding encoding,
                                        double units_per_metre) {
  const OutputKind kind = output.kind;
  switch (encoding) {
    case v1::ENCODING_RAW:
      return RawIntegers(stored, kind);
    case v1::ENCODING_RAW_ZSTD: {
      ASSIGN_OR_RETURN(const std::string raw, RawIntegers(stored, kind));
      return Compress(raw);
    }
    case v1::ENCODING_F32:
      return Metres(stored, kind, units_per_metre);
    case v1::ENCODING_F32_ZSTD: {
      ASSIGN_OR_RETURN(const std::string metres, Metres(stored, kind, units_per_metre));
      return Compress(metres);
    }
    case v1::ENCODING_JPEG: {
      if (output.extension == "jpg") return stored;
      ASSIGN_OR_RETURN(const Image<Rgb8> picture, DecodePngRgb8(stored));
      return EncodeJpeg(picture);
    }
    default:
      return stored;
  }
}

int64_t FrameMemoryBytes(const OutputSpec& output, int64_t pixels) {
  // Depth takes most while floats are decoded: the file (at most 2 bytes a pixel), the integers (2), the metres as an
  // image and as bytes (4 each). Pictures, which may hold two eyes: PNG, pixels and JPEG. Scene flow: the file alone,
  // at most its arrays.
  switch (output.kind) {
    case OutputKind::kPictures:
      return pixels * 2 * 12;
    case OutputKind::kSceneFlow:
      return pixels * 27 + kArchiveHeadBytes;
    default:
      return pixels * 12;
  }
}

}  // namespace depthtween::server
