// Results are made by hand, so what is too far from a seen pixel is known.
#include "core/upsample/fill_limit.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kAcross = 100, kDown = 20;

// Seen from x = 40 on, inferred before, at 2 m and +-0.1 m.
DepthResult HalfSeen() {
  DepthResult result{.depth_m = Image<float>(kAcross, kDown, 2.0F),
                     .sigma_m = Image<float>(kAcross, kDown, 0.1F),
                     .provenance = Image<Provenance>(kAcross, kDown, Provenance::kInferred)};
  for (int y = 0; y < kDown; ++y)
    for (int x = 40; x < kAcross; ++x) result.provenance(x, y) = x % 2 == 0 ? Provenance::kOne : Provenance::kHeld;
  return result;
}

int Known(const DepthResult& result) {
  int known = 0;
  for (int x = 0; x < kAcross; ++x) known += result.depth_m(x, 10) > 0 ? 1 : 0;
  return known;
}

TEST(FillLimit, KeepsWhatIsNear) {
  DepthResult all = HalfSeen(), near = HalfSeen(), none = HalfSeen();
  LimitFill(Fill::kAll, all);
  LimitFill(Fill::kNear, near);
  LimitFill(Fill::kNone, none);
  EXPECT_EQ(Known(all), 100);
  EXPECT_EQ(Known(near), 60 + 5) << "a twentieth of the width";
  EXPECT_EQ(Known(none), 60);
  // What is not known has neither sigma nor provenance; what was seen is not touched.
  EXPECT_EQ(near.sigma_m(10, 10), 0);
  EXPECT_EQ(near.provenance(10, 10), Provenance::kNone);
  EXPECT_EQ(near.provenance(38, 10), Provenance::kInferred);
  EXPECT_EQ(near.provenance(41, 10), Provenance::kHeld);
}

TEST(FillLimit, TakesBackWhatIsNotKnownWell) {
  DepthResult result = HalfSeen();
  result.sigma_m(38, 10) = 0.6F;
  LimitFill(Fill::kNear, result);
  EXPECT_EQ(result.depth_m(38, 10), 0);
  EXPECT_EQ(result.depth_m(39, 10), 2);
}

// Nothing was seen at all: nothing is made up.
TEST(FillLimit, NothingSeenIsNothingKnown) {
  DepthResult result = HalfSeen();
  for (int y = 0; y < kDown; ++y)
    for (int x = 0; x < kAcross; ++x) result.provenance(x, y) = Provenance::kInferred;
  LimitFill(Fill::kNear, result);
  EXPECT_EQ(Known(result), 0);
}

TEST(FillLimit, HasThreeWords) {
  EXPECT_EQ(*ParseFill("all"), Fill::kAll);
  EXPECT_EQ(*ParseFill("near"), Fill::kNear);
  EXPECT_EQ(*ParseFill("none"), Fill::kNone);
  EXPECT_THAT(std::string(ParseFill("some").status().message()), testing::HasSubstr("must be all, near or none"));
}

}  // namespace
}  // namespace depthtween
