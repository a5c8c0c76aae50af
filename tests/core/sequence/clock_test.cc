#include "core/sequence/clock.h"

#include <random>

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

}  // namespace
}  // namespace depthtween
