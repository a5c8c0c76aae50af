// Values are chosen by hand, and go through JSON bit for bit.
#include "core/sequence/registration.h"

#include <nlohmann/json.hpp>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

RegistrationEstimate Off() {
  return {.model = {.right_px = -19.25,
                    .down_px = 1.0 / 3,
                    .scale = 0.98,
                    .parallax_x_px_m = -21.6,
                    .parallax_y_px_m = 1.7,
                    .reference_m = 0.83},
          .shift_sigma_px = 0.2,
          .scale_sigma = 0.001,
          .parallax_sigma_px_m = 0.4,
          .moves_px = 20.7,
          .moves_sigma_px = 0.3,
          .keys = 13,
          .edges = 6609};
}

TEST(Registration, DisplacesByShiftScaleAndParallax) {
  const Registration registration{.right_px = 2, .down_px = -1, .scale = 1.1, .parallax_x_px_m = 6, .reference_m = 2};
  // 10 px right of the middle of 101 pixels grow by 1; at 1 m, half a 1/m nearer than the reference, 3 px of parallax.
  const Flow2 move = registration.Displacement(101, 51, 60, 25, 1.0);
  EXPECT_NEAR(move.u, 2 + 1 + 3, 1e-5);
  EXPECT_NEAR(move.v, -1, 1e-5);
  EXPECT_FALSE(registration.IsIdentity());
  EXPECT_TRUE(Registration{.reference_m = 3}.IsIdentity());
}

TEST(RegistrationEstimate, SurvivesJson) {
  const RegistrationEstimate estimate = Off();
  const nlohmann::json json = ToJson(estimate);
  EXPECT_EQ(ToJson(RegistrationEstimateFromJson(nlohmann::json::parse(json.dump()))), json);
  EXPECT_EQ(json["trusted"], true);
  EXPECT_THROW(RegistrationEstimateFromJson(nlohmann::json::object()), nlohmann::json::exception);
}

// Off is what is beyond a pixel and beyond doubt.
TEST(RegistrationEstimate, SaysWhetherDepthIsOff) {
  RegistrationEstimate estimate = Off();
  EXPECT_TRUE(estimate.IsOff());
  EXPECT_THAT(Summary(estimate), HasSubstr("20.7 px (+-0.3 px) beside those of colour: depth at 0.83 m must move by "
                                           "-19.2 px right and +0.3 px down"));
  EXPECT_THAT(Summary(estimate), HasSubstr("grow by a factor of 0.980"));
  estimate.moves_sigma_px = 8;
  EXPECT_FALSE(estimate.IsOff());
  estimate.moves_px = 0.5, estimate.moves_sigma_px = 0.1;
  EXPECT_FALSE(estimate.IsOff());
  EXPECT_THAT(Summary(estimate), HasSubstr("which is registered"));
  estimate = Off();
  estimate.reason = "too dark";
  EXPECT_FALSE(estimate.IsOff());
  EXPECT_THAT(Summary(estimate), HasSubstr("do not tell whether depth is registered to colour: too dark"));
}

}  // namespace
}  // namespace depthtween
