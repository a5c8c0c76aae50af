#include "core/sequence/clock.h"

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
  EXPECT_DOUBLE_EQ(clock.OffsetAt(kEpoch + 2'000'000'000), 10e6);
}

TEST(ClockModel, SaysWhatIsWrong) {
  EXPECT_TRUE(ClockModel().Validate().ok());
  EXPECT_THAT(ClockModel({.drift_ppm = 2e5}).Validate().message(), testing::HasSubstr("ClockModel.drift_ppm = 200000"));
  EXPECT_FALSE(ClockModel({.offset_ns = std::nan("")}).Validate().ok());
  EXPECT_FALSE(ClockModel({.offset_ns = 4e12}).Validate().ok());
  EXPECT_FALSE(ClockModel({.offset_sigma_ns = -1}).Validate().ok());
}

MemorySource Clip() {
  Sequence sequence{.camera = {.width = 4, .height = 4, .fx = 4, .fy = 4, .cx = 2, .cy = 2}, .depth_scale = 1000};
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth_m;
  for (int i = 0; i < 9; ++i) {
    sequence.color.push_back({kEpoch + i * 1'000'000, "c"});
    color.emplace_back(4, 4, Rgb8{static_cast<uint8_t>(i), 0, 0});
    if (i % 2 != 0) continue;
    sequence.depth.push_back({kEpoch + i * 1'000'000 + 500'000, "d"});
    depth_m.emplace_back(4, 4, 1.0F + static_cast<float>(i));
  }
  return {std::move(sequence), std::move(color), std::move(depth_m)};
}

// Only stamps of depth frames change, by what the model says; frames stay those of the source.
TEST(CorrectedClock, StampsDepthFramesAnew) {
  const MemorySource source = Clip();
  const CorrectedClock corrected(source, {.reference_ns = kEpoch, .offset_ns = 500'000});
  ASSERT_EQ(corrected.sequence().depth.size(), 5U);
  for (int k = 0; k < 5; ++k) {
    EXPECT_EQ(corrected.sequence().depth[k].time_ns, kEpoch + k * 2'000'000);
    EXPECT_EQ((*corrected.Depth(k))(0, 0), 1.0F + 2.0F * static_cast<float>(k));
  }
  EXPECT_EQ(corrected.sequence().color[3].time_ns, kEpoch + 3'000'000);
  EXPECT_EQ((*corrected.Color(3))(0, 0).r, 3);
}

// Depth frame k takes the time of colour frame k x ratio; what has no such frame is gone.
TEST(CorrectedClock, PairsByIndex) {
  const MemorySource source = Clip();
  EXPECT_EQ(ColorFramesPerDepth(source.sequence()), 2);
  const CorrectedClock paired = CorrectedClock::PairedByIndex(source, 4);
  ASSERT_EQ(paired.sequence().depth.size(), 3U);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(paired.sequence().depth[k].time_ns, kEpoch + k * 4'000'000);
}

}  // namespace
}  // namespace depthtween
