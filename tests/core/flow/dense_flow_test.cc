// Flow between textures that were moved by a known shift.
#include "core/flow/dense_flow.h"

#include <cmath>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// A texture with detail at several scales, seen `shift` pixels further right.
Image<Rgb8> Texture(int width, int height, double shift_x, double shift_y) {
  Image<Rgb8> image(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double u = x - shift_x, v = y - shift_y;
      const double value = 128 + 50 * std::sin(0.31 * u + 0.17 * v) + 40 * std::sin(0.11 * u - 0.23 * v) +
                           30 * std::sin(0.07 * u * 1.3 + 0.05 * v);
      const auto level = static_cast<uint8_t>(std::lround(value));
      image(x, y) = {level, level, level};
    }
  return image;
}

// The texture is moved by a known shift: away from the border, that is the flow.
TEST(DenseFlow, FindsAKnownShift) {
  const Image<uint8_t> a = Luma(Texture(160, 120, 0, 0)), b = Luma(Texture(160, 120, 3.5, -2));
  for (const int scale : {0, 1}) {
    const auto flow = DenseFlow(a, b, {.finest_scale = scale});
    ASSERT_TRUE(flow.ok()) << flow.status();
    for (int y = 20; y < 100; y += 10)
      for (int x = 20; x < 140; x += 10) {
        EXPECT_NEAR((*flow)(x, y).u, 3.5, 0.25) << x << "," << y;
        EXPECT_NEAR((*flow)(x, y).v, -2.0, 0.25) << x << "," << y;
      }
  }
}

// A start that is already right must survive: the result is still the known shift.
TEST(DenseFlow, KeepsAGoodStart) {
  const Image<uint8_t> a = Luma(Texture(160, 120, 0, 0)), b = Luma(Texture(160, 120, 6, 1));
  const Image<Flow2> start(160, 120, Flow2{6, 1});
  const auto flow = DenseFlow(a, b, {}, &start);
  ASSERT_TRUE(flow.ok());
  EXPECT_NEAR((*flow)(80, 60).u, 6, 0.25);
  EXPECT_NEAR((*flow)(80, 60).v, 1, 0.25);
}

// Nothing to match: any flow explains flat images, but no NaN may leave.
TEST(DenseFlow, IsFiniteOnFlatAndTinyImages) {
  const Image<uint8_t> flat(64, 48, uint8_t{90});
  const auto flow = DenseFlow(flat, flat, {});
  ASSERT_TRUE(flow.ok());
  for (size_t i = 0; i < flow->pixel_count(); ++i) ASSERT_TRUE(std::isfinite(flow->data()[i].u));
  const Image<uint8_t> tiny(5, 3, uint8_t{90});
  ASSERT_TRUE(DenseFlow(tiny, tiny, {}).ok());
}

TEST(DenseFlow, NamesWhatIsWrong) {
  const Image<uint8_t> a(64, 48), b(64, 47);
  EXPECT_EQ(DenseFlow(a, b, {}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(DenseFlow(a, a, {.patch_stride = 0}).status().message().find("patch_stride = 0"), std::string::npos);
}

// By definition: ac(x) = ab(x) + bc(x + ab(x)). Constant fields add; a ramp is read where the first step lands.
TEST(Compose, AddsTheSecondStepWhereTheFirstLands) {
  const Image<Flow2> ab(20, 10, Flow2{2, 1});
  Image<Flow2> bc(20, 10);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x) bc(x, y) = {static_cast<float>(x), static_cast<float>(-y)};
  const Image<Flow2> ac = Compose(ab, bc);
  EXPECT_EQ(ac(5, 4), (Flow2{2 + 7, 1 - 5}));
  EXPECT_EQ(ac(19, 9), (Flow2{2 + 19, 1 - 9}));  // clamped at the border
}

TEST(FollowFlows, IsWhatComposeHasThere) {
  Image<Flow2> ab(20, 10), bc(20, 10), cd(20, 10);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x) {
      ab(x, y) = {0.3F * static_cast<float>(y), -0.7F};
      bc(x, y) = {0.5F * static_cast<float>(x), static_cast<float>(-y)};
      cd(x, y) = {1.25F, 0.1F * static_cast<float>(x * y)};
    }
  const Image<Flow2> ad = Compose(Compose(ab, bc), cd);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x) {
      EXPECT_EQ(FollowFlows({ab, bc, cd}, x, y), ad(x, y));
      EXPECT_EQ(FollowFlows({ab}, x, y), ab(x, y));
    }
}

}  // namespace
}  // namespace depthtween
