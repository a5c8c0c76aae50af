// Beginnings of files as the specifications of their formats give them.
#include "core/io/image_kind.h"

#include "core/io/color.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::HasSubstr;
using namespace std::string_literals;

TEST(ImageKind, IsTakenFromTheFirstBytes) {
  const std::pair<std::string, std::string_view> kinds[] = {{"II*\0\x08\0\0\0"s, "a TIFF image"},
                                                            {"MM\0*\0\0\0\x08"s, "a TIFF image"},
                                                            {"v/1\x01\x02\0\0\0"s, "an OpenEXR image"},
                                                            {"BM\x36\0"s, "a BMP image"},
                                                            {"GIF89a"s, "a GIF image"},
                                                            {"RIFF\0\0\0\0WEBPVP8 "s, "a WebP image"},
                                                            {"RIFF\0\0\0\0AVI LIST"s, "a RIFF file (AVI is one)"},
                                                            {"\0\0\0\x18"
                                                             "ftypheic\0\0"s,
                                                             "a HEIC image"},
                                                            {"\0\0\0\x18"
                                                             "ftypavif\0\0"s,
                                                             "an AVIF image"},
                                                            {"\0\0\0\x18"
                                                             "ftypisom\0\0"s,
                                                             "a video (MP4 or MOV)"},
                                                            {"\xff\xd8\xff\xe0"s, "a JPEG image"},
                                                            {"P5\n640 480\n65535\n"s, "a PGM or PPM image"},
                                                            {"Pf\n640 480\n-1\n"s, "a PFM image"},
                                                            {"\x93NUMPY\x01\0"s, "a NumPy array"}};
  for (const auto& [bytes, kind] : kinds) EXPECT_EQ(ImageKind(bytes), kind);
  EXPECT_EQ(ImageKind("not an image"), "");
  EXPECT_EQ(ImageKind(""), "");
}

TEST(ImageKind, RefusalsSayHowToConvert) {
  EXPECT_THAT(DecodeColor("GIF89a"),
              HasStatus(StatusCode::kInvalidArgument,
                        AllOf(HasSubstr("is a GIF image, neither PNG nor JPEG"), HasSubstr("mogrify -format png"))));
  EXPECT_THAT(DecodeColor("no image"), HasStatus(StatusCode::kInvalidArgument, HasSubstr("of an unknown kind")));
  EXPECT_THAT(NotADepthImage("II*\0\x08\0\0\0"s),
              HasStatus(StatusCode::kInvalidArgument,
                        AllOf(HasSubstr("is a TIFF image"), HasSubstr("16-bit grey PNG"), HasSubstr("cv2.imwrite"))));
  EXPECT_THAT(NotADepthImage("\xff\xd8\xff\xe0"),
              HasStatus(StatusCode::kInvalidArgument, AllOf(HasSubstr("is a JPEG"), HasSubstr("depth is lost"))));
}

}  // namespace
}  // namespace depthtween
