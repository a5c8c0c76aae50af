// Sentences and JSON of a clock, by hand.
#include "core/sequence/clock_estimate.h"

#include <nlohmann/json.hpp>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

// The sentences follow from the numbers by hand.
TEST(ClockEstimate, IsSaidInASentence) {
  ClockEstimate estimate{.model = {.offset_ns = -4.04e6, .drift_ppm = 3012},
                         .offset_sigma_ns = 0.1e6,
                         .drift_sigma_ppm = 19.4,
                         .keys = 128,
                         .edges = 5000};
  EXPECT_EQ(Summary(estimate),
            "the depth camera's clock is 4.04 ms behind at the first colour frame (+-0.10 ms) and gains 3012 ppm (+-19 "
            "ppm); from 5000 edge pixels of 128 depth frames");
  estimate.model.drift_ppm = 0;
  EXPECT_THAT(Summary(estimate), HasSubstr("no drift can be told (+-19 ppm)"));
  estimate.reason = "too dark";
  EXPECT_EQ(Summary(estimate), "the images do not tell the depth camera's clock: too dark");
}

// What ToJson did not make is refused, whatever is missing or wrong.
TEST(ClockEstimate, RefusesOtherJson) {
  for (const char* const member : {"reason", "reference_ns", "offset_ns", "row_time_sigma_ns", "edges"}) {
    nlohmann::json estimate = ToJson(ClockEstimate());
    estimate.erase(member);
    EXPECT_THROW(ClockEstimateFromJson(estimate), nlohmann::json::exception) << member;
    estimate[member] = nlohmann::json::array();
    EXPECT_THROW(ClockEstimateFromJson(estimate), nlohmann::json::exception) << member;
  }
}

}  // namespace
}  // namespace depthtween
