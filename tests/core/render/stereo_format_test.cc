// Packings by the place of every pixel; anaglyphs by coefficients worked out by hand.
#include "core/render/stereo_format.h"

#include <cmath>
#include <set>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kEyeWidth = 6, kEyeHeight = 4;

StereoPair TestPair() {
  StereoPair pair{Image<Rgb8>(kEyeWidth, kEyeHeight), Image<Rgb8>(kEyeWidth, kEyeHeight)};
  for (int y = 0; y < kEyeHeight; ++y)
    for (int x = 0; x < kEyeWidth; ++x) {
      pair.left(x, y) = {static_cast<uint8_t>(10 * x), static_cast<uint8_t>(20 * y), 7};
      pair.right(x, y) = {static_cast<uint8_t>(10 * x), static_cast<uint8_t>(20 * y), 200};
    }
  return pair;
}

StereoPair Constant(Rgb8 left, Rgb8 right) { return {Image<Rgb8>(2, 2, left), Image<Rgb8>(2, 2, right)}; }

Rgb8 Anaglyph(StereoFormat format, Rgb8 left, Rgb8 right) { return PackStereo(format, Constant(left, right))[0](1, 1); }

TEST(StereoFormat, LeftEyeComesFirst) {
  const StereoPair pair = TestPair();
  const Image<Rgb8> beside = std::move(PackStereo(StereoFormat::kFullSbs, pair)[0]);
  const Image<Rgb8> above = std::move(PackStereo(StereoFormat::kFullTb, pair)[0]);
  ASSERT_EQ(beside.width(), 2 * kEyeWidth);
  ASSERT_EQ(above.height(), 2 * kEyeHeight);
  for (int y = 0; y < kEyeHeight; ++y)
    for (int x = 0; x < kEyeWidth; ++x) {
      EXPECT_EQ(beside(x, y), pair.left(x, y));
      EXPECT_EQ(beside(x + kEyeWidth, y), pair.right(x, y));
      EXPECT_EQ(above(x, y), pair.left(x, y));
      EXPECT_EQ(above(x, y + kEyeHeight), pair.right(x, y));
    }
  const std::vector<Image<Rgb8>> separate = PackStereo(StereoFormat::kSeparate, pair);
  ASSERT_EQ(separate.size(), 2U);
  EXPECT_EQ(separate[0](3, 2), pair.left(3, 2));
  EXPECT_EQ(separate[1](3, 2), pair.right(3, 2));
}

TEST(StereoFormat, HalvesKeepTheSizeAndConstants) {
  for (const auto& [format, width, height] : {std::tuple{StereoFormat::kHalfSbs, kEyeWidth, kEyeHeight},
                                              std::tuple{StereoFormat::kHalfTb, kEyeWidth, kEyeHeight}}) {
    const Image<Rgb8> packed = std::move(PackStereo(format, TestPair())[0]);
    EXPECT_EQ(packed.width(), width);
    EXPECT_EQ(packed.height(), height);
    EXPECT_EQ(packed(0, 0).b, 7) << "a constant stays";
    EXPECT_EQ(packed(width - 1, height - 1).b, 200);
  }
  // Black and white average to half the light: 0.5 is code 188.
  StereoPair stripes = Constant({}, {});
  stripes.left(1, 0) = {255, 255, 255};
  EXPECT_EQ(PackStereo(StereoFormat::kHalfSbs, stripes)[0](0, 0), (Rgb8{188, 188, 188}));
}

TEST(StereoFormat, HalvesOfOddSizes) {
  const StereoPair pair{Image<Rgb8>(5, 3, Rgb8{9, 9, 9}), Image<Rgb8>(5, 3, Rgb8{90, 90, 90})};
  const Image<Rgb8> beside = std::move(PackStereo(StereoFormat::kHalfSbs, pair)[0]);
  EXPECT_EQ(beside.width(), 6);
  EXPECT_EQ(beside(2, 1).r, 9);
  EXPECT_EQ(beside(3, 1).r, 90);
  EXPECT_EQ(PackStereo(StereoFormat::kHalfTb, pair)[0].height(), 4);
}

// Dubois' matrices: each column of the left, then of the right eye, in linear light, clipped to what a display shows.
TEST(StereoFormat, DuboisCoefficients) {
  const auto code = [](double linear) {
    linear = std::min(1.0, std::max(0.0, linear));
    return 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055);
  };
  const double left[3][3] = {
      {0.4561, 0.500484, 0.176381}, {-0.0400822, -0.0378246, -0.0157589}, {-0.0152161, -0.0205971, -0.00546856}};
  const double right[3][3] = {
      {-0.0434706, -0.0879388, -0.00155529}, {0.378476, 0.73364, -0.0184503}, {-0.0721527, -0.112961, 1.2264}};
  const Rgb8 primaries[3] = {{255, 0, 0}, {0, 255, 0}, {0, 0, 255}};
  for (int k = 0; k < 3; ++k) {
    const Rgb8 of_left = Anaglyph(StereoFormat::kAnaglyphDubois, primaries[k], {});
    EXPECT_NEAR(of_left.r, code(left[0][k]), 0.6);
    EXPECT_NEAR(of_left.g, code(left[1][k]), 0.6);
    EXPECT_NEAR(of_left.b, code(left[2][k]), 0.6);
    const Rgb8 of_right = Anaglyph(StereoFormat::kAnaglyphDubois, {}, primaries[k]);
    EXPECT_NEAR(of_right.r, code(right[0][k]), 0.6);
    EXPECT_NEAR(of_right.g, code(right[1][k]), 0.6);
    EXPECT_NEAR(of_right.b, code(right[2][k]), 0.6);
  }
  // Negative coefficients, where the other eye lifts them above black: white on the left, grey 188 (half the light) on
  // the right.
  const Rgb8 mixed = Anaglyph(StereoFormat::kAnaglyphDubois, {255, 255, 255}, {188, 188, 188});
  EXPECT_NEAR(mixed.g, code(-0.0936657 + 0.5029 * 1.0936657), 1.0);
  EXPECT_EQ(Anaglyph(StereoFormat::kAnaglyphDubois, {255, 255, 255}, {255, 255, 255}).r, 255) << "white stays white";
  EXPECT_NEAR(Anaglyph(StereoFormat::kAnaglyphDubois, {255, 255, 255}, {255, 255, 255}).g, 255, 1);
}

// BT.601 luma of (100, 50, 200): 0.299 * 100 + 0.587 * 50 + 0.114 * 200 = 82.05.
TEST(StereoFormat, HalfColourAndGrey) {
  EXPECT_EQ(Anaglyph(StereoFormat::kAnaglyphHalfColor, {100, 50, 200}, {1, 2, 3}), (Rgb8{82, 2, 3}));
  EXPECT_EQ(Anaglyph(StereoFormat::kAnaglyphGrey, {100, 50, 200}, {40, 40, 40}), (Rgb8{82, 40, 40}));
}

TEST(StereoFormat, NamesAndSuffixes) {
  std::set<std::string_view> names;
  for (const StereoFormatFacts& facts : StereoFormats()) {
    EXPECT_TRUE(names.insert(facts.name).second);
    EXPECT_EQ(&FactsOf(facts.format), &facts);
    EXPECT_EQ(*ParseStereoFormat(facts.name), facts.format);
    EXPECT_EQ(PackStereo(facts.format, TestPair()).size(), facts.suffixes.size());
  }
  EXPECT_EQ(FactsOf(StereoFormat::kFullSbs).suffixes[0], "_LRF_Full_SBS");
  EXPECT_EQ(FactsOf(StereoFormat::kFullSbs).packing, StereoPacking::kSideBySide);
  EXPECT_TRUE(FactsOf(StereoFormat::kAnaglyphDubois).full_chroma);
  const auto unknown = ParseStereoFormat("vhs");
  EXPECT_EQ(unknown.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(unknown.status().message()), testing::HasSubstr("full-sbs"));
}

}  // namespace
}  // namespace depthtween
