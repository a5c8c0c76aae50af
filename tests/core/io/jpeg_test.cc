// JPEG against the image that was encoded, within what quantisation may change, and against libjpeg.
#include "core/io/jpeg.h"

#include <cstdio>
#include <cstdlib>

#include <jpeglib.h>

#include "core/io/color.h"
#include "core/io/png.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::_;
using testing::HasSubstr;

// Colour that changes slowly, as in photographs.
Image<Rgb8> Gradient(int width, int height) {
  Image<Rgb8> image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x)
      image(x, y) = {static_cast<uint8_t>(4 * x), static_cast<uint8_t>(5 * y), static_cast<uint8_t>(200 - 2 * x)};
  }
  return image;
}

int WorstDifference(const Image<Rgb8>& a, const Image<Rgb8>& b) {
  int worst = 0;
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) {
      const Rgb8 p = a(x, y), q = b(x, y);
      worst = std::max({worst, std::abs(p.r - q.r), std::abs(p.g - q.g), std::abs(p.b - q.b)});
    }
  }
  return worst;
}

// Writes with libjpeg directly, what our encoder does not offer.
std::string RawJpeg(int components, J_COLOR_SPACE space, int width, int height, bool progressive = false) {
  jpeg_compress_struct codec = {};
  jpeg_error_mgr errors = {};
  codec.err = jpeg_std_error(&errors);
  jpeg_create_compress(&codec);
  unsigned char* buffer = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int)
  jpeg_mem_dest(&codec, &buffer, &size);
  codec.image_width = static_cast<JDIMENSION>(width);
  codec.image_height = static_cast<JDIMENSION>(height);
  codec.input_components = components;
  codec.in_color_space = space;
  jpeg_set_defaults(&codec);
  if (progressive) jpeg_simple_progression(&codec);
  jpeg_start_compress(&codec, TRUE);
  std::string row_bytes(static_cast<size_t>(width * components), '\x64');
  JSAMPROW row = reinterpret_cast<JSAMPROW>(row_bytes.data());
  for (int y = 0; y < height; ++y) jpeg_write_scanlines(&codec, &row, 1);
  jpeg_finish_compress(&codec);
  jpeg_destroy_compress(&codec);
  std::string bytes(reinterpret_cast<char*>(buffer), size);
  std::free(buffer);
  return bytes;
}

// Quantisation at quality 95 moves a smooth image by a few grey levels at most.
TEST(Jpeg, KeepsSmoothColor) {
  const Image<Rgb8> image = Gradient(45, 31);
  const auto decoded = DecodeJpeg(*EncodeJpeg(image));
  ASSERT_THAT(decoded, IsOk());
  EXPECT_LE(WorstDifference(*decoded, image), 6);
}

// Red against blue of the same brightness: 4:2:0 would smear the seam over two pixels, 4:4:4 must not.
TEST(Jpeg, ColorEdgesStayInPlace) {
  Image<Rgb8> image(16, 16);
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) image(x, y) = x < 7 ? Rgb8{200, 40, 40} : Rgb8{40, 98, 240};
  }
  const auto decoded = DecodeJpeg(*EncodeJpeg(image));
  ASSERT_THAT(decoded, IsOk());
  EXPECT_LE(WorstDifference(*decoded, image), 24);
}

TEST(Jpeg, ReadsGreyAndProgressive) {
  const auto grey = DecodeJpeg(RawJpeg(1, JCS_GRAYSCALE, 9, 5));
  ASSERT_THAT(grey, IsOk());
  EXPECT_TRUE(((*grey)(4, 2) == Rgb8{100, 100, 100}));
  const auto progressive = DecodeJpeg(RawJpeg(3, JCS_RGB, 33, 20, /*progressive=*/true));
  ASSERT_THAT(progressive, IsOk());
  EXPECT_EQ(progressive->width(), 33);
  EXPECT_TRUE(((*progressive)(32, 19) == Rgb8{100, 100, 100}));
}

TEST(Jpeg, RefusesCmyk) {
  EXPECT_THAT(DecodeJpeg(RawJpeg(4, JCS_CMYK, 8, 8)), HasStatus(StatusCode::kInvalidArgument, HasSubstr("CMYK")));
}

// The frame header (SOF0) holds height and width at bytes 5..8 of its segment.
TEST(Jpeg, RefusesHugeHeaders) {
  std::string file = *EncodeJpeg(Gradient(8, 8));
  const size_t frame = file.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  file.replace(frame + 5, 4, "\xea\x60\xea\x60");  // 60000 x 60000
  EXPECT_THAT(DecodeJpeg(file), HasStatus(StatusCode::kResourceExhausted, HasSubstr("60000 x 60000")));
  EXPECT_THAT(DecodeJpeg(*EncodeJpeg(Gradient(20, 10)), {.max_pixels = 199}),
              HasStatus(StatusCode::kResourceExhausted, HasSubstr("199")));
}

// libjpeg alone would fill what is missing with grey and only warn.
TEST(Jpeg, NamesEveryTruncation) {
  const std::string file = *EncodeJpeg(NoisyImage<Rgb8>(24, 16));
  for (size_t size = 0; size < file.size(); ++size)
    EXPECT_THAT(DecodeJpeg(file.substr(0, size)), HasStatus(StatusCode::kDataLoss, _)) << size << " bytes";
}

// Bytes between the last pixel and the end, which webcams leave, change no pixel; many of them are lost pixels.
TEST(Jpeg, ReadsPastStrayBytes) {
  const Image<Rgb8> image = Gradient(45, 31);
  const std::string file = *EncodeJpeg(image), body = file.substr(0, file.size() - 2),
                    end = file.substr(file.size() - 2);
  const auto clean = DecodeJpeg(file);
  for (const std::string& stray : {std::string(1, '\0'), std::string("\x00\x12\x34\x56", 4), std::string(60, '\0')}) {
    const auto decoded = DecodeJpeg(body + stray + end);
    ASSERT_THAT(decoded, IsOk());
    EXPECT_TRUE(SamePixels(*decoded, *clean));
  }
  EXPECT_THAT(DecodeJpeg(body + std::string(2000, '\x21') + end),
              HasStatus(StatusCode::kDataLoss, HasSubstr("extraneous")));
  // Between the segments of the header any number is harmless.
  const size_t frame = file.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  const auto decoded = DecodeJpeg(file.substr(0, frame) + std::string(300, '\0') + file.substr(frame));
  ASSERT_THAT(decoded, IsOk());
  EXPECT_TRUE(SamePixels(*decoded, *clean));
}

// Pixels that are missing in the middle are not made up, whatever stands in their place.
TEST(Jpeg, RefusesMissingPixels) {
  const std::string file = *EncodeJpeg(NoisyImage<Rgb8>(64, 48));
  const size_t half = file.size() / 2;
  EXPECT_THAT(DecodeJpeg(file.substr(0, half) + file.substr(file.size() - 2)), HasStatus(StatusCode::kDataLoss, _));
  std::string restarted = file;
  restarted.replace(half, 2, "\xff\xd3");  // a restart marker where none is due
  EXPECT_THAT(DecodeJpeg(restarted), HasStatus(StatusCode::kDataLoss, _));
}

// The precision stands behind the length of the frame header, the kind of coding in its marker.
TEST(Jpeg, NamesKindsThatAreNotRead) {
  const std::string file = *EncodeJpeg(Gradient(8, 8));
  const size_t frame = file.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  std::string changed = file;
  changed[frame + 4] = 12;
  EXPECT_THAT(DecodeJpeg(changed), HasStatus(StatusCode::kInvalidArgument, HasSubstr("12 bits per sample")));
  changed = file;
  changed[frame + 1] = '\xc3';
  EXPECT_THAT(DecodeJpeg(changed), HasStatus(StatusCode::kInvalidArgument, HasSubstr("without loss")));
}

TEST(Jpeg, RefusesWhatCannotBeEncoded) {
  EXPECT_THAT(EncodeJpeg(Image<Rgb8>()), HasStatus(StatusCode::kInvalidArgument, HasSubstr("no pixels")));
  EXPECT_THAT(EncodeJpeg(Image<Rgb8>(1, 1), 0), HasStatus(StatusCode::kInvalidArgument, HasSubstr("quality = 0")));
  EXPECT_THAT(EncodeJpeg(Image<Rgb8>(1, 1), 101), HasStatus(StatusCode::kInvalidArgument, HasSubstr("1 to 100")));
}

// First bytes decide, not the name.
TEST(Color, TellsPngFromJpeg) {
  const Image<Rgb8> image = Gradient(8, 8);
  EXPECT_TRUE(SamePixels(*DecodeColor(*EncodePngRgb8(image)), image));
  EXPECT_THAT(DecodeColor(*EncodeJpeg(image)), IsOk());
  EXPECT_THAT(DecodeColor("GIF89a"), HasStatus(StatusCode::kInvalidArgument, HasSubstr("neither PNG nor JPEG")));
  EXPECT_THAT(DecodeColor(""), HasStatus(StatusCode::kDataLoss, HasSubstr("empty")));
}

}  // namespace
}  // namespace depthtween
