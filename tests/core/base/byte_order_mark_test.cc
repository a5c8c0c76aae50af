// Byte-order marks by the bytes that the Unicode standard (table 2-4) gives them.
#include "core/base/byte_order_mark.h"

#include "gtest/gtest.h"

namespace depthtween {
namespace {

TEST(ByteOrderMark, IsSkippedAtTheBeginningOnly) {
  EXPECT_EQ(SkipByteOrderMark("\xEF\xBB\xBF# list"), "# list");
  EXPECT_EQ(SkipByteOrderMark("# list\xEF\xBB\xBF"), "# list\xEF\xBB\xBF");
  EXPECT_EQ(SkipByteOrderMark("\xEF\xBB"), "\xEF\xBB");
  EXPECT_EQ(SkipByteOrderMark(""), "");
}

TEST(ByteOrderMark, TellsUtf16) {
  EXPECT_TRUE(LooksLikeUtf16("\xFF\xFE#"));
  EXPECT_TRUE(LooksLikeUtf16("\xFE\xFF"));
  EXPECT_FALSE(LooksLikeUtf16("\xEF\xBB\xBF"));
  EXPECT_FALSE(LooksLikeUtf16(""));
}

}  // namespace
}  // namespace depthtween
