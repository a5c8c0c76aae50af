#include "core/io/image_kind.h"

#include <array>
#include <utility>

#include "absl/strings/str_cat.h"

namespace depthtween {
namespace {

using namespace std::string_view_literals;

// What a file of some kind begins with.
constexpr std::array kBeginnings = {
    std::pair("\x89PNG\r\n\x1a\n"sv, "a PNG image"sv),
    std::pair("\xff\xd8\xff"sv, "a JPEG image"sv),
    std::pair("II*\0"sv, "a TIFF image"sv),
    std::pair("MM\0*"sv, "a TIFF image"sv),
    std::pair("II+\0"sv, "a BigTIFF image"sv),
    std::pair("MM\0+"sv, "a BigTIFF image"sv),
    std::pair("v/1\x01"sv, "an OpenEXR image"sv),
    std::pair("GIF8"sv, "a GIF image"sv),
    std::pair("qoif"sv, "a QOI image"sv),
    std::pair("\xff\x0a"sv, "a JPEG XL image"sv),
    std::pair("\0\0\0\x0cJXL "sv, "a JPEG XL image"sv),
    std::pair("\0\0\0\x0cjP  "sv, "a JPEG 2000 image"sv),
    std::pair("\xff\x4f\xff\x51"sv, "a JPEG 2000 image"sv),
    std::pair("#?RADIANCE"sv, "a Radiance HDR image"sv),
    std::pair("#?RGBE"sv, "a Radiance HDR image"sv),
    std::pair("\x93NUMPY"sv, "a NumPy array"sv),
    std::pair("PK\x03\x04"sv, "a zip archive (NPZ is one)"sv),
    std::pair("\x1f\x8b"sv, "a gzip file"sv),
    std::pair("%PDF"sv, "a PDF document"sv),
    std::pair("version https://git-lfs"sv, "a Git LFS pointer, whose file was not fetched (git lfs pull)"sv),
    std::pair("<!DOCTYPE"sv, "a web page, as a failed download leaves one"sv),
    std::pair("<html"sv, "a web page, as a failed download leaves one"sv),
    std::pair("BM"sv, "a BMP image"sv),
};

// ISO media files say what they are behind a length: "....ftypheic".
std::string_view IsoKind(std::string_view bytes) {
  if (bytes.size() < 12 || bytes.substr(4, 4) != "ftyp") return {};
  const std::string_view brand = bytes.substr(8, 4);
  if (brand == "avif" || brand == "avis") return "an AVIF image";
  for (const std::string_view heic : {"heic", "heix", "hevc", "heim", "heis", "mif1", "msf1"})
    if (brand == heic) return "a HEIC image";
  return "a video (MP4 or MOV)";
}

// Portable any-maps: P1 to P7, Pf and PF, then white space.
std::string_view PnmKind(std::string_view bytes) {
  if (bytes.size() < 3 || bytes[0] != 'P' || (bytes[2] != '\n' && bytes[2] != ' ' && bytes[2] != '\r')) return {};
  if (bytes[1] >= '1' && bytes[1] <= '7') return "a PGM or PPM image";
  if (bytes[1] == 'f' || bytes[1] == 'F') return "a PFM image";
  return {};
}

// A sentence about bytes of any kind: "is a TIFF image".
std::string WhatItIs(std::string_view bytes) {
  const std::string_view kind = ImageKind(bytes);
  return absl::StrCat("is ", kind.empty() ? "of an unknown kind" : absl::string_view(kind.data(), kind.size()));
}

}  // namespace

std::string_view ImageKind(std::string_view bytes) {
  for (const auto& [beginning, kind] : kBeginnings)
    if (bytes.starts_with(beginning)) return kind;
  if (bytes.starts_with("RIFF") && bytes.size() >= 12)
    return bytes.substr(8, 4) == "WEBP" ? "a WebP image" : "a RIFF file (AVI is one)";
  if (const std::string_view kind = IsoKind(bytes); !kind.empty()) return kind;
  return PnmKind(bytes);
}

absl::Status NotAColorImage(std::string_view bytes) {
  return absl::InvalidArgumentError(absl::StrCat(
      WhatItIs(bytes),
      ", neither PNG nor JPEG, and colour must be one of them, whatever its name ends with: convert it, for "
      "instance by `mogrify -format png FILES` (ImageMagick)"));
}

absl::Status NotADepthImage(std::string_view bytes) {
  const bool jpeg = ImageKind(bytes) == "a JPEG image";
  return absl::InvalidArgumentError(absl::StrCat(
      WhatItIs(bytes),
      jpeg ? ", and depth must be a 16-bit grey PNG: JPEG changes values and has 8 bits, so its depth is lost; export "
             "the "
             "sensor's values again"
           : ", and depth must be a 16-bit grey PNG, whatever its name ends with. Convert it so that values are kept: "
             "whole numbers by `python3 -c \"import cv2,sys; cv2.imwrite(sys.argv[2], cv2.imread(sys.argv[1], -1))\" "
             "FILE OUT.png`; metres in floating point times depth_scale, rounded, as uint16"));
}

}  // namespace depthtween
