// Units of time stamps that the test chose: the same camera's stamps, written in each unit.
#include "core/sequence/time_unit.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr TimeUnit kAll[] = {TimeUnit::kSeconds, TimeUnit::kMilliseconds, TimeUnit::kMicroseconds,
                             TimeUnit::kNanoseconds};

// Stamps of a camera, in 1e-9 of the unit.
std::vector<Stamp> Written(TimeUnit unit, double start_s, double period_s, int count) {
  double per_second = 1;
  for (int i = 0; i < static_cast<int>(unit); ++i) per_second *= 1000;
  std::vector<Stamp> stamps;
  for (int i = 0; i < count; ++i) stamps.push_back(Stamp((start_s + i * period_s) * per_second * 1e9));
  return stamps;
}

TEST(TimeUnit, HasNames) {
  for (const TimeUnit unit : kAll) EXPECT_EQ(ParseTimeUnit(ShortName(unit)), unit);
  EXPECT_EQ(ParseTimeUnit("minutes"), std::nullopt);
  EXPECT_EQ(LongName(TimeUnit::kMicroseconds), "microseconds");
}

// Digits are exact in every unit, which a double could not hold.
TEST(Stamp, IsExactToTheNanosecond) {
  EXPECT_EQ(StampNs(*ParseStamp("1305031232.193716001"), TimeUnit::kSeconds), 1305031232193716001);
  EXPECT_EQ(StampNs(*ParseStamp("1305031232193.716001"), TimeUnit::kMilliseconds), 1305031232193716001);
  EXPECT_EQ(StampNs(*ParseStamp("1305031232193716.001"), TimeUnit::kMicroseconds), 1305031232193716001);
  EXPECT_EQ(StampNs(*ParseStamp("1305031232193716001"), TimeUnit::kNanoseconds), 1305031232193716001);
  EXPECT_EQ(StampNs(*ParseStamp("-0.5"), TimeUnit::kMilliseconds), -500000);
  EXPECT_EQ(StampNs(*ParseStamp("1305031232193716001"), TimeUnit::kSeconds), std::nullopt);
  for (const char* bad : {"", ".", "1e3", "nan", "12x", "9223372036854775808", "1.2.3", "-"})
    EXPECT_FALSE(ParseStamp(bad).ok()) << bad;
}

// Every rate that cameras have, in every unit, from the start of a recording and since 1970.
TEST(GuessTimeUnit, KnowsTheUnitOfACamera) {
  for (const TimeUnit unit : kAll)
    for (const double fps : {240.0, 90.0, 30.0, 5.0, 1.0})
      for (const double start_s : {0.0, 12.0, 1305031232.2}) {
        const auto guess = GuessTimeUnit(Written(unit, start_s, 1 / fps, 9));
        ASSERT_TRUE(guess.ok()) << guess.status();
        EXPECT_EQ(*guess, unit) << fps << " fps from " << start_s << " in " << LongName(unit);
      }
}

TEST(GuessTimeUnit, TakesASingleStampForATimeSince1970) {
  for (const TimeUnit unit : kAll) EXPECT_EQ(*GuessTimeUnit(Written(unit, 1305031232.2, 1, 1)), unit);
  EXPECT_EQ(*GuessTimeUnit(Written(TimeUnit::kSeconds, 5, 1, 1)), TimeUnit::kSeconds);
  EXPECT_EQ(*GuessTimeUnit({}), TimeUnit::kSeconds);
}

// 33 apart and 1.3 billion since the start: Unix seconds of a time lapse, or milliseconds of a machine up for 15 days.
TEST(GuessTimeUnit, RefusesWhatMayBeEither) {
  EXPECT_THAT(std::string(GuessTimeUnit(Written(TimeUnit::kSeconds, 1305031232, 33, 9)).status().message()),
              AllOf(HasSubstr("seconds since 1970"), HasSubstr("33 ms"), HasSubstr("'# unit: s' or '# unit: ms'")));
}

// Whatever the units of both, and however often depth comes.
TEST(GuessDepthTimeUnit, FollowsFromColor) {
  for (const TimeUnit color_unit : kAll)
    for (const TimeUnit depth_unit : kAll)
      for (const double period_s : {1 / 30.0, 0.133, 1.0})
        for (const double start_s : {0.0, 12.0}) {
          const auto color = Written(color_unit, start_s, 1 / 30.0, 90);
          const auto depth = Written(depth_unit, start_s, period_s, std::max(2, static_cast<int>(3 / period_s)));
          EXPECT_EQ(GuessDepthTimeUnit(color, color_unit, depth), depth_unit)
              << LongName(color_unit) << " and " << LongName(depth_unit) << " each " << period_s << " from " << start_s;
        }
}

// A depth frame each ten seconds is rare, and still in colour's seconds.
TEST(GuessDepthTimeUnit, KeepsColorsUnitWhereItServes) {
  const auto color = Written(TimeUnit::kSeconds, 0, 1 / 30.0, 900);
  EXPECT_EQ(GuessDepthTimeUnit(color, TimeUnit::kSeconds, Written(TimeUnit::kSeconds, 0, 10, 3)), TimeUnit::kSeconds);
  EXPECT_EQ(GuessDepthTimeUnit(color, TimeUnit::kSeconds, Written(TimeUnit::kSeconds, 4, 1, 1)), TimeUnit::kSeconds);
  // Clocks ten minutes apart say nothing of units, and rates do.
  const auto apart = Written(TimeUnit::kSeconds, 600, 0.133, 9);
  EXPECT_EQ(GuessDepthTimeUnit(color, TimeUnit::kSeconds, apart), TimeUnit::kSeconds);
  const auto apart_ms = Written(TimeUnit::kMilliseconds, 600, 0.133, 9);
  EXPECT_EQ(GuessDepthTimeUnit(color, TimeUnit::kSeconds, apart_ms), TimeUnit::kMilliseconds);
}

}  // namespace
}  // namespace depthtween
