// The clock of a clip, through JSON bit for bit, and in the stamps it gives.
#include "core/session/clip_clock.h"

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/capture/moving_discs.h"
#include "tests/core/session/nine_frames.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

// Every bit must come back: all tasks of a job see the same stamps.
TEST(ClipClock, SurvivesJson) {
  const ClipClock clock{.model = {.reference_ns = 1305031232193716000, .offset_ns = 1e6 / 3, .drift_ppm = -1.0 / 7},
                        .color_per_depth = 8};
  const ClipClock read = ClockOf(nlohmann::json::parse(nlohmann::json{{"clock", ToJson(clock)}}.dump()));
  EXPECT_EQ(read.model.reference_ns, clock.model.reference_ns);
  EXPECT_EQ(read.model.offset_ns, clock.model.offset_ns);
  EXPECT_EQ(read.model.drift_ppm, clock.model.drift_ppm);
  EXPECT_EQ(read.color_per_depth, 8);
  EXPECT_THROW(ClockOf(nlohmann::json::object()), nlohmann::json::exception) << "every plan and report has one";
}

// The same of an estimate, with its sigmas and why it is not to be trusted.
TEST(ClipClock, CarriesItsEstimateThroughJson) {
  const ClipClock clock{.estimate = ClockEstimate{.reason = "too dark",
                                                  .model = {.reference_ns = 7, .offset_ns = 1e6 / 3, .drift_ppm = 1.5},
                                                  .offset_sigma_ns = 1e5 / 7,
                                                  .drift_sigma_ppm = 0.1,
                                                  .stamp_sigma_ns = 2e5 / 7,
                                                  .row_time_ns = -3.5,
                                                  .row_time_sigma_ns = 0.25,
                                                  .keys = 12,
                                                  .edges = 34567}};
  const nlohmann::json json = {{"clock", ToJson(clock)}};
  const ClipClock read = ClockOf(nlohmann::json::parse(json.dump()));
  ASSERT_TRUE(read.estimate.has_value());
  EXPECT_EQ(ToJson(read), ToJson(clock));
  EXPECT_EQ(json["clock"]["estimate"]["trusted"], false);
  EXPECT_FALSE(ClockOf(nlohmann::json{{"clock", ToJson(ClipClock())}}).estimate.has_value());
}

// Of nine frames no clock can be told: the stamps are kept, and the reason with them. The other choices look at no
// frame.
TEST(DecideClock, KeepsStampsWithoutAnEstimateToTrust) {
  const MemorySource recording = NineFrames();
  const auto kept = DecideClock(recording, *ParseClockChoice("estimate"), 1);
  ASSERT_TRUE(kept.ok()) << kept.status();
  EXPECT_EQ(kept->model.ColorTime(12345), 12345);
  ASSERT_TRUE(kept->estimate.has_value());
  EXPECT_THAT(kept->estimate->reason, HasSubstr("too few"));
  EXPECT_EQ(DecideClock(recording, *ParseClockChoice("index"), 1)->color_per_depth, 2);
  EXPECT_EQ(DecideClock(recording, *ParseClockChoice("4,5"), 1)->model.offset_ns, 4e6);
  EXPECT_FALSE(DecideClock(recording, *ParseClockChoice("stamps"), 1)->estimate.has_value());
}

// Ten minutes apart and 4 ms: what the discs show is known, and the estimate is of both together.
TEST(EstimateAnyClock, BridgesClocksThatDoNotMeet) {
  const MovingDiscs apart({.offset_ms = 600'004.0});
  const auto estimate = EstimateAnyClock(apart, {.max_keys = 24, .threads = 2});
  ASSERT_TRUE(estimate.ok()) << estimate.status();
  ASSERT_EQ(estimate->reason, "");
  EXPECT_NEAR(1e-6 * estimate->model.offset_ns, 600'004.0, 0.5);
}

// Where nothing can be told, first frames meet, and the reason stays.
TEST(EstimateAnyClock, BringsFirstFramesTogetherAtLeast) {
  Sequence sequence = NineFrames().sequence();
  std::vector<Image<Rgb8>> color(9);
  std::vector<Image<float>> depth_m(5);
  for (FrameRef& frame : sequence.depth) frame.time_ns += 600'000'000'000;
  const MemorySource apart(std::move(sequence), std::move(color), std::move(depth_m));
  const auto clock = DecideClock(apart, *ParseClockChoice("estimate"), 1);
  ASSERT_TRUE(clock.ok()) << clock.status();
  EXPECT_THAT(clock->estimate->reason, HasSubstr("too few"));
  EXPECT_EQ(clock->model.ColorTime(apart.sequence().depth[0].time_ns), 0);
  EXPECT_TRUE(CheckOverlap(InputOf(apart.sequence(), *clock, 1)).ok());
}

}  // namespace
}  // namespace depthtween
