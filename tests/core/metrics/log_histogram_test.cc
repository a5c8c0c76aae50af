// Quantiles against sorting.
#include "core/metrics/log_histogram.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// Sorting all keys gives the quantiles exactly; bins are 0.2 % wide, so their means differ by less than that.
TEST(LogHistogram, QuantilesEqualThoseOfSortedKeys) {
  std::mt19937 random(7);
  std::lognormal_distribution<float> errors(-4.0F, 1.5F);
  LogHistogram histogram;
  std::vector<float> keys(20001);
  for (float& key : keys) histogram.Add(key = errors(random), 1.0);
  std::sort(keys.begin(), keys.end());
  for (double q : {0.01, 0.25, 0.5, 0.9, 0.99}) {
    const double exact = keys[static_cast<size_t>(std::ceil(q * 20001)) - 1];
    EXPECT_NEAR(histogram.Quantile(q) / exact, 1.0, 0.002) << q;
  }
}

// Truth: counted by hand.
TEST(LogHistogram, SharesCountWhatIsAtMost) {
  LogHistogram histogram;
  EXPECT_EQ(histogram.ShareUpTo(1.0F), 0.0);
  for (const float key : {0.0F, 0.5F, 1.0F, 2.0F}) histogram.Add(key, 0);
  EXPECT_EQ(histogram.ShareUpTo(0.0F), 0.25);
  EXPECT_EQ(histogram.ShareUpTo(1.0F), 0.75);
  EXPECT_EQ(histogram.ShareUpTo(300.0F), 1.0);
}

TEST(LogHistogram, KeepsExtremesAndTotals) {
  LogHistogram histogram;
  EXPECT_EQ(histogram.Quantile(0.5), 0.0);
  for (float key : {0.0F, -0.0F, 1e-30F, 1e9F}) histogram.Add(key, 2.0);
  EXPECT_EQ(histogram.count(), 4);
  EXPECT_EQ(histogram.bins().front().count, 3);
  EXPECT_EQ(histogram.bins().back().payload_sum, 2.0);
  EXPECT_NEAR(histogram.Quantile(0.0), 0.0, 1e-30);
  EXPECT_EQ(histogram.Quantile(1.0), 1e9F);
}

}  // namespace
}  // namespace depthtween
