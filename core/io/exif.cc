#include "core/io/exif.h"

#include <array>
#include <cstdint>
#include <optional>

#include "absl/strings/str_format.h"
#include "core/io/jpeg.h"
#include "core/io/png.h"

namespace depthtween {
namespace {

constexpr int kAsStored = 1;
constexpr unsigned kOrientationTag = 0x0112, kTypeShort = 3;

// Numbers of either byte order at any place; none past the end.
class Bytes {
 public:
  Bytes(std::string_view bytes, bool little_endian) : bytes_(bytes), little_endian_(little_endian) {}
  std::optional<uint32_t> Number(size_t at, size_t size) const {
    if (at > bytes_.size() || size > bytes_.size() - at) return std::nullopt;
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) {
      const size_t from = little_endian_ ? at + size - 1 - i : at + i;
      value = value << 8 | static_cast<unsigned char>(bytes_[from]);
    }
    return value;
  }

 private:
  std::string_view bytes_;
  bool little_endian_;
};

// The first directory of a TIFF structure: a count, then entries of 12 bytes: tag, type, count, value.
int OrientationOfTiff(std::string_view tiff) {
  if (!tiff.starts_with("II") && !tiff.starts_with("MM")) return kAsStored;
  const Bytes bytes(tiff, tiff.starts_with("II"));
  const size_t directory = bytes.Number(4, 4).value_or(UINT32_MAX);
  const uint32_t entries = bytes.Number(directory, 2).value_or(0);
  for (uint32_t i = 0; i < entries; ++i) {
    const size_t entry = directory + 2 + size_t{12} * i;
    const std::optional<uint32_t> tag = bytes.Number(entry, 2);
    if (!tag.has_value()) return kAsStored;
    if (*tag != kOrientationTag || bytes.Number(entry + 2, 2) != kTypeShort) continue;
    const uint32_t value = bytes.Number(entry + 8, 2).value_or(kAsStored);
    return value >= 1 && value <= 8 ? static_cast<int>(value) : kAsStored;
  }
  return kAsStored;
}

// Segments: 0xFF, marker, length (itself included), data; up to the first scan.
std::string_view TiffOfJpeg(std::string_view jpeg) {
  constexpr uint32_t kApp1 = 0xE1, kStartOfScan = 0xDA, kEndOfImage = 0xD9;
  constexpr std::string_view kExif("Exif\0\0", 6);
  const Bytes bytes(jpeg, /*little_endian=*/false);
  for (size_t at = 2; bytes.Number(at, 1) == 0xFF;) {
    const std::optional<uint32_t> marker = bytes.Number(at + 1, 1);
    if (marker == 0xFF) {  // a fill byte
      ++at;
      continue;
    }
    const std::optional<uint32_t> length = bytes.Number(at + 2, 2);
    if (!marker.has_value() || !length.has_value() || *length < 2) return {};
    if (*marker == kStartOfScan || *marker == kEndOfImage) return {};
    const std::string_view data = jpeg.substr(at + 4, *length - 2);
    if (*marker == kApp1 && data.starts_with(kExif)) return data.substr(kExif.size());
    at += 2 + *length;
  }
  return {};
}

// Chunks: length, type, data, checksum. The chunk may stand before or behind the pixels.
std::string_view TiffOfPng(std::string_view png) {
  const Bytes bytes(png, /*little_endian=*/false);
  for (size_t at = 8;;) {
    const std::optional<uint32_t> length = bytes.Number(at, 4);
    if (!length.has_value()) return {};
    if (png.substr(at + 4 <= png.size() ? at + 4 : png.size(), 4) == "eXIf") return png.substr(at + 8, *length);
    at += size_t{12} + *length;
  }
}

}  // namespace

int ExifOrientation(std::string_view image) {
  if (LooksLikeJpeg(image)) return OrientationOfTiff(TiffOfJpeg(image));
  if (LooksLikePng(image)) return OrientationOfTiff(TiffOfPng(image));
  return kAsStored;
}

absl::Status CheckOrientation(std::string_view image) {
  constexpr std::array<const char*, 9> kTurns = {"",
                                                 "as stored",
                                                 "mirrored",
                                                 "upside down",
                                                 "upside down and mirrored",
                                                 "on its side and mirrored",
                                                 "on its side",
                                                 "on its side and mirrored",
                                                 "on its side"};
  const int orientation = ExifOrientation(image);
  if (orientation == kAsStored) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "has EXIF orientation %d: its pixels are stored %s, and viewers turn them. Which of the two depth and "
      "camera.json are for is not known. If for the picture as viewers show it, turn the pixels of all frames: "
      "`exiftran -ai FILES` (JPEG, without loss) or `mogrify -auto-orient FILES`. If for the pixels as stored, remove "
      "the tag: "
      "`exiftool -Orientation= FILES`",
      orientation, kTurns[static_cast<size_t>(orientation)]));
}

}  // namespace depthtween
