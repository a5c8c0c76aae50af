// The thin lens by hand.
#include "core/render/lens.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr Camera kCamera{.width = 720, .height = 480, .fx = 1000, .fy = 1000, .cx = 359.5, .cy = 239.5};

std::string Refusal(const LensOptions& lens, double focus_m) {
  const absl::StatusOr<CircleOfConfusion> circle = MakeCircleOfConfusion(kCamera, lens, focus_m);
  if (circle.ok()) return "accepted";
  EXPECT_EQ(circle.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(circle.status().message());
}

// By hand: A = 50 mm / 2 = 25 mm, R = 1000 px * 25 mm / (2 * (2000 mm - 50 mm)) = 6.4103 px.
TEST(CircleOfConfusion, FollowsTheThinLens) {
  const CircleOfConfusion circle = *MakeCircleOfConfusion(kCamera, {.focal_mm = 50, .fstop = 2}, 2.0);
  EXPECT_NEAR(circle.scale_px, 6.4103, 1e-4);
  EXPECT_FLOAT_EQ(circle.RadiusPx(2.0F), 0.0F);
  EXPECT_NEAR(circle.RadiusPx(4.0F), 6.4103 / 2, 1e-4);
  EXPECT_NEAR(circle.RadiusPx(1.0F), -6.4103, 1e-4);
  EXPECT_NEAR(circle.RadiusPx(0.0F), 6.4103, 1e-4) << "unknown is infinitely far";
}

TEST(CircleOfConfusion, IsCutOffAtItsLimit) {
  const CircleOfConfusion circle{.scale_px = 30, .focus_m = 2, .limit_px = 12};
  EXPECT_FLOAT_EQ(circle.RadiusPx(100.0F), 12.0F);
  EXPECT_FLOAT_EQ(circle.RadiusPx(0.1F), -12.0F);
}

// 720 pixels at a focal length of 1000 pixels are 36 mm at one of 50 mm.
TEST(MakeCircleOfConfusion, TakesTheFocalLengthFromTheSensor) {
  const double stated = MakeCircleOfConfusion(kCamera, {.focal_mm = 50, .fstop = 1.8}, 3.0)->scale_px;
  EXPECT_DOUBLE_EQ(MakeCircleOfConfusion(kCamera, {.fstop = 1.8, .sensor = "full-frame"}, 3.0)->scale_px, stated);
  EXPECT_LT(MakeCircleOfConfusion(kCamera, {.fstop = 1.8, .sensor = "aps-c"}, 3.0)->scale_px, 0.7 * stated);
  EXPECT_DOUBLE_EQ(MakeCircleOfConfusion(kCamera, {.focal_mm = 50, .fstop = 8, .aperture_mm = 50 / 1.8}, 3.0)->scale_px,
                   stated);
}

TEST(MakeCircleOfConfusion, RefusesWhatNoLensCanDo) {
  using testing::StartsWith;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(Refusal({.fstop = -1.8}, 2), StartsWith("fstop = -1.8, must be"));
  EXPECT_THAT(Refusal({.fstop = nan}, 2), StartsWith("fstop = nan, must be"));
  EXPECT_THAT(Refusal({.focal_mm = -50}, 2), StartsWith("focal_mm = -50, must be"));
  EXPECT_THAT(Refusal({.aperture_mm = 1e6}, 2), StartsWith("aperture_mm = 1e+06, must be"));
  EXPECT_THAT(Refusal({.sensor = "phone"}, 2), StartsWith("sensor = 'phone', must be one of: full-frame, "));
  EXPECT_THAT(Refusal({}, -1), StartsWith("focus_m = -1, must be"));
  EXPECT_THAT(Refusal({}, nan), StartsWith("focus_m = nan, must be"));
  EXPECT_THAT(Refusal({.focal_mm = 500}, 0.4), StartsWith("focus_m = 0.4, must be a finite distance beyond"));
}

}  // namespace
}  // namespace depthtween
