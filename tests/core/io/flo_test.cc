// Flow files against bytes made by the formats' definitions.
#include "core/io/flo.h"

#include <cstring>
#include <string>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// The bytes of a 2 x 1 field by the format's definition.
TEST(Flo, IsWhatTheFormatSays) {
  Image<Flow2> flow(2, 1);
  flow(0, 0) = {1.0F, -2.0F};
  flow(1, 0) = {0.5F, 0.0F};
  const std::string bytes = EncodeFlo(flow);
  const std::string expected("PIEH\2\0\0\0\1\0\0\0\0\0\x80\x3f\0\0\0\xc0\0\0\0\x3f\0\0\0\0", 28);
  EXPECT_EQ(bytes, expected);
  const auto back = DecodeFlo(bytes);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ((*back)(0, 0), flow(0, 0));
  EXPECT_EQ((*back)(1, 0), flow(1, 0));
}

TEST(Flo, RefusesDamage) {
  const std::string bytes = EncodeFlo(Image<Flow2>(3, 2));
  for (const std::string& broken :
       {bytes.substr(0, bytes.size() - 1), bytes + "x", "PIEX" + bytes.substr(4), std::string()})
    EXPECT_EQ(DecodeFlo(broken).status().code(), absl::StatusCode::kDataLoss);
  std::string huge = bytes;
  huge[7] = 0x7f;
  EXPECT_EQ(DecodeFlo(huge).status().code(), absl::StatusCode::kResourceExhausted);
}

// Rows lie from the bottom up: the last four bytes are the first row's.
TEST(Pfm, RowsFromTheBottom) {
  Image<float> image(1, 2);
  image(0, 0) = 1.0F;
  image(0, 1) = -2.0F;
  const std::string bytes = EncodePfm(image);
  EXPECT_EQ(bytes, std::string("Pf\n1 2\n-1.0\n\0\0\0\xc0\0\0\x80\x3f", 20));
  const auto back = DecodePfm(bytes);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ((*back)(0, 0), 1.0F);
  EXPECT_EQ((*back)(0, 1), -2.0F);
}

// As some writers leave it: blanks at the ends of lines.
TEST(Pfm, TakesTrailingBlanks) {
  const auto image = DecodePfm(std::string("Pf \n1 1 \n-1.0 \n\0\0\x80\x3f", 19));
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_EQ((*image)(0, 0), 1.0F);
}

TEST(Pfm, RefusesDamageAndOtherKinds) {
  const std::string bytes = EncodePfm(Image<float>(2, 2));
  for (const std::string& broken : {bytes.substr(0, bytes.size() - 1), "PF" + bytes.substr(2), std::string("Pf\n2"),
                                    std::string("Pf\n2 2\n1.0\n") + std::string(16, '\0')})
    EXPECT_EQ(DecodePfm(broken).status().code(), absl::StatusCode::kDataLoss) << broken.substr(0, 12);
}

}  // namespace
}  // namespace depthtween
