// Sizes of pictures on the command line, by hand.
#include "core/tools/picture_size.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween::tools {
namespace {

// Truth: what is written is what is read; everything else is refused whole.
TEST(PictureSize, ReadsWidthAndHeight) {
  int width = 0, height = 0;
  ASSERT_TRUE(ParsePictureSize("512x424", width, height).ok());
  EXPECT_EQ(width, 512);
  EXPECT_EQ(height, 424);
  for (const char* wrong : {"", "512", "512x", "x424", "512x424x3", "512 x424 ", "ax b"}) {
    const absl::Status status = ParsePictureSize(wrong, width, height);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << wrong;
    EXPECT_THAT(status.message(), testing::HasSubstr("512x424")) << wrong;
  }
}

}  // namespace
}  // namespace depthtween::tools
