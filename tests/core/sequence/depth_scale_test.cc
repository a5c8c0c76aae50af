// Medians that a scale in use would explain, and one that none does.
#include "core/sequence/depth_scale.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace depthtween {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST(ImplausibleDepthScale, SaysWhichWouldDo) {
  EXPECT_EQ(ImplausibleDepthScale(1.5, 1000), std::nullopt);
  EXPECT_EQ(ImplausibleDepthScale(0, 1000), std::nullopt);
  // 15000 units: 15 m at 1000 is too far to be proposed, 3 m at 5000 is not.
  EXPECT_THAT(*ImplausibleDepthScale(15000, 1),
              AllOf(HasSubstr("1.5e+04 m"), testing::Not(HasSubstr("1000 (")), HasSubstr("5000 (median 3 m)")));
  EXPECT_THAT(*ImplausibleDepthScale(0.015, 100000), HasSubstr("1000 (median 1.5 m)"));
  EXPECT_THAT(*ImplausibleDepthScale(0.001, 1000), HasSubstr("check how many units"));
}

}  // namespace
}  // namespace depthtween
