// UTF-8 by the byte sequences of Unicode's table 3-7.
#include "core/base/utf8.h"

#include <string>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

TEST(Utf8, AcceptsWhatIsWellFormed) {
  for (const std::string& good :
       {std::string(), std::string("plain"), std::string("\xC3\xBC"), std::string("\xE6\xB7\xB1"),
        std::string("\xF0\x9F\x8E\xA5"), std::string("\xED\x9F\xBF"), std::string("\xF4\x8F\xBF\xBF")})
    EXPECT_TRUE(IsUtf8(good)) << good;
}

TEST(Utf8, RefusesWhatIsNot) {
  for (const std::string& bad :
       {std::string("\xFF"), std::string("\xC0\xAF"), std::string("\xE0\x80\x80"), std::string("\xED\xA0\x80"),
        std::string("\xF4\x90\x80\x80"), std::string("\xE2\x82"), std::string("\x80"), std::string("a\xC3")})
    EXPECT_FALSE(IsUtf8(bad)) << bad;
}

}  // namespace
}  // namespace depthtween
