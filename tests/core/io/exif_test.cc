// EXIF written by hand, byte by byte as EXIF 2.32 and TIFF 6.0 say, into images that our encoders made.
#include "core/io/exif.h"

#include "core/io/color.h"
#include "core/io/jpeg.h"
#include "core/io/png.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::HasSubstr;
using namespace std::string_literals;

// One directory with a tag before the orientation; `big` is Motorola's byte order.
std::string Tiff(int orientation, bool big) {
  const auto number = [big](uint32_t value, int size) {
    std::string bytes;
    for (int i = 0; i < size; ++i) bytes += static_cast<char>(value >> 8 * (big ? size - 1 - i : i));
    return bytes;
  };
  const auto entry = [&](uint32_t tag, uint32_t value) {
    return number(tag, 2) + number(3, 2) + number(1, 4) + number(value, 2) + "\0\0"s;
  };
  return (big ? "MM"s : "II"s) + number(42, 2) + number(8, 4) + number(2, 2) + entry(0x0100, 6) +
         entry(0x0112, static_cast<uint32_t>(orientation)) + number(0, 4);
}

std::string JpegWith(const std::string& tiff) {
  const std::string jpeg = *EncodeJpeg(Image<Rgb8>(8, 6)), data = "Exif\0\0"s + tiff;
  const auto length = static_cast<uint32_t>(data.size() + 2);
  return jpeg.substr(0, 2) + "\xff\xe1"s + static_cast<char>(length >> 8) + static_cast<char>(length) + data +
         jpeg.substr(2);
}

std::string PngWith(const std::string& tiff) { return PngFile(1, 1, 8, 2, "\0\1\2\3"s, PngChunk("eXIf", tiff)); }

TEST(Exif, OrientationIsReadFromBothFormatsAndByteOrders) {
  for (int orientation = 1; orientation <= 8; ++orientation)
    for (const bool big : {false, true}) {
      EXPECT_EQ(ExifOrientation(JpegWith(Tiff(orientation, big))), orientation);
      EXPECT_EQ(ExifOrientation(PngWith(Tiff(orientation, big))), orientation);
    }
}

TEST(Exif, NothingOrNonsenseIsAsStored) {
  EXPECT_EQ(ExifOrientation(*EncodeJpeg(Image<Rgb8>(8, 6))), 1);
  EXPECT_EQ(ExifOrientation(*EncodePngRgb8(Image<Rgb8>(8, 6))), 1);
  EXPECT_EQ(ExifOrientation(JpegWith(Tiff(9, true))), 1);
  EXPECT_EQ(ExifOrientation(JpegWith(Tiff(0, false))), 1);
  EXPECT_EQ(ExifOrientation(""), 1);
  // Cut anywhere, it is read to its end and no further.
  const std::string jpeg = JpegWith(Tiff(6, true)), png = PngWith(Tiff(6, false));
  for (size_t size = 0; size < jpeg.size(); ++size) {
    const int orientation = ExifOrientation(jpeg.substr(0, size));
    EXPECT_TRUE(orientation == 1 || orientation == 6);
  }
  for (size_t size = 0; size < png.size(); ++size) {
    const int orientation = ExifOrientation(png.substr(0, size));
    EXPECT_TRUE(orientation == 1 || orientation == 6);
  }
}

TEST(Exif, TurnedColourIsRefusedWithTheWayOut) {
  EXPECT_THAT(DecodeColor(JpegWith(Tiff(1, true))), IsOk());
  EXPECT_THAT(DecodeColor(PngWith(Tiff(1, true))), IsOk());
  EXPECT_THAT(DecodeColor(JpegWith(Tiff(3, true))),
              HasStatus(StatusCode::kInvalidArgument, AllOf(HasSubstr("EXIF orientation 3"), HasSubstr("upside down"),
                                                            HasSubstr("exiftran"), HasSubstr("exiftool"))));
  EXPECT_THAT(DecodeColor(PngWith(Tiff(6, false))),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("EXIF orientation 6")));
}

}  // namespace
}  // namespace depthtween
