// Clocks whose offset, drift and jitter the test put in.
#include "core/sequence/clock.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

std::vector<FrameRef> Stamps(int count, double jitter_ns, bool drop) {
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 1);
  std::vector<FrameRef> frames;
  for (int i = 0; i < count; ++i) {
    if (drop && i % 7 == 3) continue;
    frames.push_back({.time_ns = int64_t{33333333} * i + static_cast<int64_t>(jitter_ns * noise(random))});
  }
  return frames;
}

// The jitter put in is the jitter found; a regular clock has none, with dropped frames as without.
TEST(StampJitter, IsWhatWasPutIn) {
  EXPECT_EQ(StampJitterNs(Stamps(100, 0, false)), 0);
  EXPECT_EQ(StampJitterNs(Stamps(100, 0, true)), 0);
  EXPECT_NEAR(static_cast<double>(StampJitterNs(Stamps(1000, 2e6, true))), 2e6, 3e5);
  EXPECT_EQ(StampJitterNs(Stamps(3, 2e6, false)), 0);
}

// The median of gaps is untouched by a dropped frame.
TEST(MedianPeriod, IsThePeriod) {
  EXPECT_EQ(MedianPeriodNs(Stamps(100, 0, true)), 33333333);
  EXPECT_EQ(MedianPeriodNs(Stamps(1, 0, false)), 0);
}

// Stamps of 2011: a double could not hold them, differences it can.
constexpr int64_t kEpoch = 1305031232193716001;

// By definition: no offset and no drift is the stamp itself.
TEST(ClockModel, IdentityIsExact) {
  for (const int64_t stamp : {int64_t{0}, int64_t{-7}, kEpoch}) {
    EXPECT_EQ(ClockModel().ColorTime(stamp), stamp);
    EXPECT_EQ(ClockModel({.reference_ns = kEpoch}).ColorTime(stamp), stamp);
  }
}

// A clock 4 ms ahead that gains 3 ms a second shows kEpoch + 2 s + 4 ms + 6 ms at kEpoch + 2 s.
TEST(ClockModel, TakesBackOffsetAndDriftToTheNanosecond) {
  const ClockModel clock{.reference_ns = kEpoch, .offset_ns = 4e6, .drift_ppm = 3000};
  EXPECT_EQ(clock.ColorTime(kEpoch + 4'000'000), kEpoch);
  EXPECT_EQ(clock.ColorTime(kEpoch + 2'010'000'000), kEpoch + 2'000'000'000);
  EXPECT_EQ(clock.ColorTime(kEpoch - 2'002'000'000), kEpoch - 2'000'000'000);
}

// One clock counts from 1970, the other from when it was switched on: within the 256 ns that a double is off by there.
TEST(ClockModel, BridgesDifferentEpochs) {
  const ClockModel clock{.reference_ns = kEpoch, .offset_ns = -static_cast<double>(kEpoch)};
  EXPECT_TRUE(clock.Validate().ok());
  EXPECT_NEAR(static_cast<double>(clock.ColorTime(5'000'000'000) - kEpoch), 5e9, 256);
  // Where that leaves the range of a stamp, it ends there.
  EXPECT_EQ(clock.ColorTime(INT64_MAX - 1), INT64_MAX);
}

TEST(ClockModel, SaysWhatIsWrong) {
  EXPECT_TRUE(ClockModel().Validate().ok());
  EXPECT_THAT(ClockModel({.drift_ppm = 2e5}).Validate().message(), testing::HasSubstr("ClockModel.drift_ppm = 200000"));
  EXPECT_FALSE(ClockModel({.offset_ns = std::nan("")}).Validate().ok());
  EXPECT_FALSE(ClockModel({.offset_ns = 4e18}).Validate().ok());
}

// Colour every millisecond; depth with every second colour frame, stamped half a millisecond late.
Sequence Clip() {
  Sequence sequence;
  for (int i = 0; i < 9; ++i) {
    sequence.color.push_back({kEpoch + i * 1'000'000, "c"});
    if (i % 2 == 0) sequence.depth.push_back({kEpoch + i * 1'000'000 + 500'000, "d"});
  }
  return sequence;
}

// Only stamps of depth frames change, by what the model says.
TEST(CorrectDepthStamps, StampsDepthFramesAnew) {
  const Sequence corrected = CorrectDepthStamps(Clip(), {.reference_ns = kEpoch, .offset_ns = 500'000});
  ASSERT_EQ(corrected.depth.size(), 5U);
  for (int k = 0; k < 5; ++k) EXPECT_EQ(corrected.depth[k].time_ns, kEpoch + k * 2'000'000);
  EXPECT_EQ(corrected.color[3].time_ns, kEpoch + 3'000'000);
}

// Colour frames every 100 ms, and depth frames at the given milliseconds after the first one.
Sequence HandMade(const std::vector<int64_t>& color_ms, const std::vector<int64_t>& depth_ms) {
  Sequence sequence;
  for (const int64_t ms : color_ms) sequence.color.push_back({kEpoch + 1'000'000 * ms, "c"});
  for (const int64_t ms : depth_ms) sequence.depth.push_back({kEpoch + 1'000'000 * ms, "d"});
  return sequence;
}
std::vector<int64_t> DepthMs(const Sequence& sequence) {
  std::vector<int64_t> ms;
  for (const FrameRef& frame : sequence.depth) ms.push_back((frame.time_ns - kEpoch) / 1'000'000);
  return ms;
}

// Regular clocks say what they mean: only what lies within a fiftieth of a period has its colour frame's stamp.
TEST(PairDepthWithinJitter, LeavesRegularStamps) {
  const Sequence paired = PairDepthWithinJitter(HandMade({0, 100, 200, 300, 400, 500}, {1, 131, 261, 391}));
  EXPECT_THAT(DepthMs(paired), testing::ElementsAre(0, 131, 261, 391));
}

// Stamps that wander by as much as they differ tell no difference.
TEST(PairDepthWithinJitter, TakesWanderingStampsForTheColourFrames) {
  const Sequence wandering = HandMade({0, 130, 190, 320, 390, 520}, {10, 140, 220, 330});
  EXPECT_THAT(DepthMs(PairDepthWithinJitter(wandering)), testing::ElementsAre(0, 130, 190, 320));
}

// A clock that is ahead by more than stamps wander says something, of the frames too that it happens to put near one.
TEST(PairDepthWithinJitter, LeavesAClockThatIsAhead) {
  const std::vector<int64_t> color = {0, 102, 199, 302, 399, 502, 600};
  const std::vector<int64_t> far = {43, 141, 240, 338, 443, 541, 606};
  EXPECT_THAT(DepthMs(PairDepthWithinJitter(HandMade(color, far))), testing::ElementsAreArray(far));
  // No single one of these is further than four deviations, but all are on one side.
  const std::vector<int64_t> steady = {14, 115, 213, 316, 413, 516, 614};
  EXPECT_THAT(DepthMs(PairDepthWithinJitter(HandMade(color, steady))), testing::ElementsAreArray(steady));
}

// Two depth frames are never of one colour frame, and none passes another.
TEST(PairDepthWithinJitter, KeepsStampsAscending) {
  const Sequence crowded = HandMade({0, 130, 190, 320, 390, 520}, {10, 120, 150, 185, 200, 330});
  const std::vector<int64_t> ms = DepthMs(PairDepthWithinJitter(crowded));
  EXPECT_THAT(ms, testing::ElementsAre(0, 120, 150, 185, 200, 320));
  EXPECT_TRUE(std::is_sorted(ms.begin(), ms.end()));
}

// Depth frame k takes the time of colour frame k x ratio; what has no such frame is gone.
TEST(PairDepthByIndex, IgnoresStamps) {
  EXPECT_EQ(ColorFramesPerDepth(Clip()), 2);
  const Sequence paired = PairDepthByIndex(Clip(), 4);
  ASSERT_EQ(paired.depth.size(), 3U);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(paired.depth[k].time_ns, kEpoch + k * 4'000'000);
}

// The forms that the header lists, and what is none of them.
TEST(ClockChoice, IsReadAsWritten) {
  EXPECT_EQ(ParseClockChoice("stamps")->mode, ClockChoice::Mode::kStamps);
  EXPECT_EQ(ParseClockChoice("index")->mode, ClockChoice::Mode::kIndex);
  EXPECT_EQ(ParseClockChoice("estimate")->mode, ClockChoice::Mode::kEstimate);
  const auto offset = ParseClockChoice("-2.5");
  ASSERT_TRUE(offset.ok()) << offset.status();
  EXPECT_EQ(offset->mode, ClockChoice::Mode::kGiven);
  EXPECT_EQ(offset->offset_ms, -2.5);
  EXPECT_EQ(offset->drift_ppm, 0.0);
  EXPECT_EQ(ParseClockChoice("4,3000")->drift_ppm, 3000.0);
  for (const char* wrong : {"", "sundial", "4,", "4,5,6", "nan", "1e13", "\x1b"})
    EXPECT_EQ(ParseClockChoice(wrong).status().code(), absl::StatusCode::kInvalidArgument) << wrong;
  EXPECT_THAT(std::string(ParseClockChoice("sundial").status().message()),
              testing::HasSubstr("'sundial', must be stamps, index"));
  EXPECT_FALSE(ParseClockChoice("4" + std::string(64, ' ')).ok()) << "too long to be kept";
}

}  // namespace
}  // namespace depthtween
