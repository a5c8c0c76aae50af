// PNG is lossless, so every bit must come back; files of other writers are built chunk by chunk (RFC 2083).
#include "core/io/png.h"

#include <gtest/gtest.h>
// rapidcheck needs gtest before it.
#include <rapidcheck/gtest.h>
#include <sys/resource.h>

#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::ContainsRegex;
using testing::HasSubstr;
using namespace std::string_literals;

// PNG is lossless: every bit pattern must come back.
TEST(Png, RoundTripsEveryKindBitForBit) {
  const auto grey16 = NoisyImage<uint16_t>(37, 23);
  const auto grey8 = NoisyImage<uint8_t>(37, 23);
  const auto rgb8 = NoisyImage<Rgb8>(37, 23);
  const auto rgb16 = NoisyImage<Rgb16>(37, 23);
  for (const int compression : {0, 1, 9}) {
    EXPECT_TRUE(SamePixels(*DecodePng16(*EncodePng16(grey16, compression)), grey16));
    EXPECT_TRUE(SamePixels(*DecodePng8(*EncodePng8(grey8, compression)), grey8));
    EXPECT_TRUE(SamePixels(*DecodePngRgb8(*EncodePngRgb8(rgb8, compression)), rgb8));
    EXPECT_TRUE(SamePixels(*DecodePngRgb16(*EncodePngRgb16(rgb16, compression)), rgb16));
  }
}

// A view with a stride larger than its width is a crop of its owner.
TEST(Png, EncodesCrops) {
  auto image = NoisyImage<uint16_t>(16, 8);
  const ImageView<const uint16_t> crop(image.row(2) + 5, 7, 4, 16);
  const auto decoded = DecodePng16(*EncodePng16(crop));
  ASSERT_THAT(decoded, IsOk());
  EXPECT_TRUE(SamePixels<uint16_t>(decoded->view(), crop));
}

RC_GTEST_PROP(Png, RoundTripsAnySize, ()) {
  const int width = *rc::gen::inRange(1, 40), height = *rc::gen::inRange(1, 40);
  const auto image = NoisyImage<uint16_t>(width, height, *rc::gen::arbitrary<uint32_t>());
  const auto decoded = DecodePng16(*EncodePng16(image));
  RC_ASSERT(decoded.ok());
  RC_ASSERT(SamePixels(*decoded, image));
}

// Pixels written by hand below, so the expected colours are known: grey 16 has 0x1234, big endian in the file.
TEST(Png, ReadsSixteenBitsBigEndian) {
  const auto image = DecodePng16(PngFile(2, 1, 16, 0, "\0\x12\x34\xff\xfe"s));
  ASSERT_THAT(image, IsOk());
  EXPECT_EQ((*image)(0, 0), 0x1234);
  EXPECT_EQ((*image)(1, 0), 0xFFFE);
}

TEST(Png, ConvertsAnyKindToColor) {
  const Rgb8 red = {255, 0, 0}, grey = {85, 85, 85};
  const std::string palette = PngChunk("PLTE", "\xff\0\0\x55\x55\x55"s);
  const std::string one_transparent = PngChunk("tRNS", "\0"s);
  struct {
    const char* what;
    std::string file;
    Rgb8 expected;
  } cases[] = {
      {"8-bit grey", PngFile(1, 1, 8, 0, "\0\x55"s), grey},
      {"2-bit grey: 1 of 3", PngFile(1, 1, 2, 0, "\0\x40"s), grey},
      {"16-bit grey", PngFile(1, 1, 16, 0, "\0\x55\x55"s), grey},
      {"8-bit RGB", PngFile(1, 1, 8, 2, "\0\xff\0\0"s), red},
      {"16-bit RGB", PngFile(1, 1, 16, 2, "\0\xff\xff\0\0\0\0"s), red},
      {"palette", PngFile(1, 1, 8, 3, "\0\0"s, palette), red},
      {"1-bit palette", PngFile(1, 1, 1, 3, "\0\x80"s, palette), grey},
      {"palette with a transparent entry", PngFile(1, 1, 8, 3, "\0\0"s, palette + one_transparent), red},
      {"grey with alpha", PngFile(1, 1, 8, 4, "\0\x55\x10"s), grey},
      {"RGB with alpha", PngFile(1, 1, 8, 6, "\0\xff\0\0\x10"s), red},
      {"16-bit RGB with alpha", PngFile(1, 1, 16, 6, "\0\xff\xff\0\0\0\0\0\0"s), red},
  };
  for (const auto& c : cases) {
    SCOPED_TRACE(c.what);
    const auto image = DecodePngRgb8(c.file);
    ASSERT_THAT(image, IsOk());
    EXPECT_TRUE((*image)(0, 0) == c.expected);
  }
}

// Values are measurements: a depth file of another kind is refused with what it is, never converted.
TEST(Png, RefusesOtherKindsOfDepth) {
  const auto refused = [](const std::string& file, const char* found) {
    EXPECT_THAT(DecodePng16(file), HasStatus(StatusCode::kInvalidArgument,
                                             AllOf(HasSubstr(found), ContainsRegex("must be (a PNG, )?16-bit grey"))));
  };
  refused(PngFile(1, 1, 8, 0, "\0\0"s), "8-bit grey");
  refused(PngFile(1, 1, 16, 2, "\0\0\0\0\0\0\0"s), "16-bit RGB");
  refused(PngFile(1, 1, 8, 6, "\0\0\0\0\0"s), "8-bit RGB with alpha");
  refused(PngFile(1, 1, 8, 3, "\0\0"s, PngChunk("PLTE", "\0\0\0"s)), "8-bit palette");
  refused("\xff\xd8\xff\xe0 JFIF", "JPEG");
}

// The header promises 3.6 gigapixels; the answer must come from the header alone. Peak memory is the proof.
TEST(Png, RefusesHugeHeadersAtNoCost) {
  struct rusage before = {}, after = {};
  getrusage(RUSAGE_SELF, &before);
  const std::string bomb = PngHeader(60000, 60000, 16, 0) + PngChunk("IDAT", std::string(1000, 'x'));
  EXPECT_THAT(DecodePng16(bomb), HasStatus(StatusCode::kResourceExhausted, HasSubstr("60000 x 60000")));
  EXPECT_THAT(DecodePngRgb8(bomb), HasStatus(StatusCode::kResourceExhausted, HasSubstr("60000 x 60000")));
  // Each side allowed, together over 64 megapixels.
  EXPECT_THAT(DecodePng8(PngHeader(32768, 2000, 8, 0)),
              HasStatus(StatusCode::kResourceExhausted, HasSubstr("64000000")));
  // Within the limits, but a kilobyte cannot hold it.
  EXPECT_THAT(DecodePng16(PngHeader(8000, 8000, 16, 0) + std::string(1000, 'x')),
              HasStatus(StatusCode::kDataLoss, HasSubstr("cut short")));
  EXPECT_THAT(DecodePng8(PngHeader(0, 5, 8, 0)), HasStatus(StatusCode::kInvalidArgument, HasSubstr("0 x 5")));
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 16 * 1024);  // KiB
}

TEST(Png, LimitsAreTheCallers) {
  const std::string file = *EncodePng8(Image<uint8_t>(20, 10));
  EXPECT_THAT(DecodePng8(file, {.max_pixels = 200, .max_side = 20}), IsOk());
  EXPECT_THAT(DecodePng8(file, {.max_pixels = 199}), HasStatus(StatusCode::kResourceExhausted, HasSubstr("199")));
  EXPECT_THAT(DecodePng8(file, {.max_side = 19}), HasStatus(StatusCode::kResourceExhausted, HasSubstr("19")));
}

// A file cut anywhere is damaged, whatever is missing.
TEST(Png, NamesEveryTruncation) {
  const std::string file = *EncodePng16(NoisyImage<uint16_t>(9, 7));
  for (size_t size = 0; size < file.size(); ++size)
    EXPECT_THAT(DecodePng16(file.substr(0, size)), HasStatus(StatusCode::kDataLoss, testing::_)) << size << " bytes";
}

// Every chunk has a checksum, so one changed byte anywhere must not pass unseen. A changed header may promise another
// image before its checksum is looked at; that is refused too, by another name.
TEST(Png, NoticesEveryChangedByte) {
  const std::string file = *EncodePng16(NoisyImage<uint16_t>(9, 7));
  for (size_t i = 0; i < file.size(); ++i) {
    std::string changed = file;
    changed[i] ^= 0x41;
    EXPECT_FALSE(DecodePng16(changed).ok()) << "byte " << i;
  }
  std::string checksum_changed = file;
  checksum_changed[file.size() - 12 - 1] ^= 1;  // the pixels' checksum stands before the 12 bytes of the last chunk
  EXPECT_THAT(DecodePng16(checksum_changed), HasStatus(StatusCode::kDataLoss, HasSubstr("CRC")));
}

// A profile whose checksum is wrong, as some editors leave it, says nothing of the pixels.
TEST(Png, ReadsPixelsBesideADamagedProfile) {
  std::string profile = PngChunk("iCCP", "sRGB\0\0nothing"s);
  profile.back() ^= 1;
  const auto image = DecodePng8(PngFile(1, 1, 8, 0, "\0\7"s, profile));
  ASSERT_THAT(image, IsOk());
  EXPECT_EQ((*image)(0, 0), 7);
}

// Fewer rows than promised.
TEST(Png, NoticesMissingPixels) {
  EXPECT_THAT(DecodePng8(PngFile(2, 3, 8, 0, "\0\1\2"s)), HasStatus(StatusCode::kDataLoss, testing::_));
}

// A text chunk may unpack to gigabytes; it is not looked at.
TEST(Png, SkipsWhatIsNoPixel) {
  const std::string text = PngChunk("zTXt", "Comment\0\0garbage that is no zlib stream"s);
  const auto image = DecodePng8(PngFile(1, 1, 8, 0, "\0\7"s, text));
  ASSERT_THAT(image, IsOk());
  EXPECT_EQ((*image)(0, 0), 7);
}

TEST(Png, RefusesToEncodeNothing) {
  EXPECT_THAT(EncodePng8(Image<uint8_t>()), HasStatus(StatusCode::kInvalidArgument, HasSubstr("no pixels")));
  EXPECT_THAT(EncodePng8(Image<uint8_t>(1, 1), 10),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("compression = 10")));
}

TEST(Png, ErrorsOfReadNameTheFile) {
  const TemporaryFolder folder;
  Put(folder / "bad.png", "not an image");
  EXPECT_THAT(ReadPng16(folder / "bad.png"), HasStatus(StatusCode::kDataLoss, HasSubstr("bad.png: not a PNG")));
  EXPECT_THAT(ReadPng8(folder / "none.png"), HasStatus(StatusCode::kNotFound, HasSubstr("none.png")));
}

}  // namespace
}  // namespace depthtween
