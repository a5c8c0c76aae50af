// Stamps and intervals. Digits are exact, and intervals cover each frame once by definition.
#include "core/sequence/sequence.h"

#include <cmath>

#include "core/sequence/interval.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using ::testing::HasSubstr;

Sequence Clip(std::vector<int64_t> color, std::vector<int64_t> depth) {
  Sequence s{.camera = {.width = 64, .height = 48, .fx = 60, .fy = 60, .cx = 31.5, .cy = 23.5}, .depth_scale = 1000};
  for (int64_t t : color) s.color.push_back({t, "rgb/" + std::to_string(t) + ".png"});
  for (int64_t t : depth) s.depth.push_back({t, "depth/" + std::to_string(t) + ".png"});
  return s;
}

// Written digits are exact decimal nanoseconds, which a double could not hold for a stamp of 2011.
TEST(ParseSeconds, IsExactToTheNanosecond) {
  EXPECT_EQ(*ParseSeconds("1305031232.193716001"), 1305031232193716001);
  EXPECT_EQ(*ParseSeconds("-0.5"), -500000000);
  EXPECT_EQ(FormatSeconds(*ParseSeconds("0.004166667")), "0.004166667");
  for (const char* bad : {"", ".", "1e3", "nan", "12x", "99999999999999999999", "1.2.3", "-"})
    EXPECT_FALSE(ParseSeconds(bad).ok()) << bad;
}

TEST(Validate, NamesWhatIsWrongAndHowToMendIt) {
  EXPECT_TRUE(Validate(Clip({0, 1, 2}, {0, 2})).ok());
  EXPECT_THAT(Validate(Clip({0, 2, 1}, {0, 2})).message(), HasSubstr("rgb/1.png"));
  EXPECT_THAT(Validate(Clip({0, 1}, {})).message(), HasSubstr("depth.txt lists no frames"));
  Sequence s = Clip({0, 1}, {0, 1});
  s.camera.fx = 0;
  EXPECT_THAT(Validate(s).message(), HasSubstr("camera.fx = 0"));
  s.camera.fx = std::nan("");
  EXPECT_THAT(Validate(s).message(), HasSubstr("camera.fx = nan"));
  s.camera.fx = 60;
  s.depth_scale = 0;
  EXPECT_THAT(Validate(s).message(), HasSubstr("depth_scale"));
}

// A clock may bring any two streams together, so it is no fault of the sequence; the message has the clock that would.
TEST(CheckOverlap, NamesTheClockByWhichFirstFramesMeet) {
  const int64_t s = 1'000'000'000;
  EXPECT_TRUE(Validate(Clip({0, s}, {600 * s, 601 * s})).ok());
  EXPECT_THAT(std::string(CheckOverlap(Clip({0, s}, {600 * s, 601 * s})).message()),
              ::testing::AllOf(HasSubstr("do not overlap"), HasSubstr("--clock=600000.000")));
  EXPECT_THAT(std::string(CheckOverlap(Clip({10 * s, 11 * s}, {0, s})).message()), HasSubstr("--clock=-10000.000"));
  // Ten seconds have been taken off already.
  EXPECT_THAT(std::string(CheckOverlap(Clip({0, s}, {5 * s, 6 * s}), 10'000).message()), HasSubstr("=15000.000"));
  EXPECT_TRUE(CheckOverlap(Clip({0, s}, {s, 2 * s})).ok());
  EXPECT_TRUE(CheckOverlap(Clip({s, 2 * s}, {0, s})).ok());
}

// By definition every colour frame is in exactly one interval, in order, whatever the stamps.
TEST(PlanIntervals, CoversEveryFrameOnce) {
  const Sequence s = Clip({-3, 0, 1, 2, 5, 9, 10, 11, 12}, {0, 4, 5, 10});
  const std::vector<Interval> plan = PlanIntervals(s);
  ASSERT_EQ(plan.size(), 4U);
  int next = 0;
  for (const Interval& i : plan) {
    EXPECT_EQ(i.first_frame, next);
    next += i.frame_count;
  }
  EXPECT_EQ(next, 9);
  EXPECT_EQ(plan[0].key_before, -1);
  EXPECT_EQ(plan[1].frame_count, 3);  // 0 1 2 between keys at 0 and 4; nothing lies in [4, 5)
  EXPECT_EQ(plan[2].key_before, 2);
  EXPECT_EQ(plan[2].frame_count, 3);  // 5 9 10: the frame at the last key closes its interval
  EXPECT_EQ(plan[3].key_after, -1);
  EXPECT_TRUE(plan[3].Held());
}

TEST(PlanIntervals, OneKeyHoldsEverything) {
  const std::vector<Interval> plan = PlanIntervals(Clip({0, 1, 2}, {1}));
  ASSERT_EQ(plan.size(), 2U);
  EXPECT_TRUE(plan[0].Held());
  EXPECT_TRUE(plan[1].Held());
  EXPECT_EQ(plan[1].frame_count, 2);
}

TEST(KeepEveryNthDepth, KeepsTheFirstAndEveryNth) {
  const Sequence kept = KeepEveryNthDepth(Clip({0, 9}, {0, 1, 2, 3, 4}), 2);
  ASSERT_EQ(kept.depth.size(), 3U);
  EXPECT_EQ(kept.depth[1].time_ns, 2);
}

}  // namespace
}  // namespace depthtween
