// JSON of a self-check: what is written must be read.
#include "core/sequence/self_check.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

// What is written is what is read: every member is there again, and there is nothing else to write. Doubles and large
// numbers keep every bit.
TEST(SelfCheckJson, GoesThereAndBack) {
  const SelfCheck check = {.summary = "on your clip it errs by 7.1 mm",
                           .maps_checked = 12,
                           .maps_held_out = 40,
                           .pixels = int64_t{1} << 40,
                           .methods = {{.name = "ours",
                                        .rmse_mm = 7.1,
                                        .mae_mm = 1.0 / 3.0,
                                        .edge_band_rmse_mm = 20.5,
                                        .completeness = 0.99,
                                        .within_one_sigma = 0.7},
                                       {.name = "hold", .rmse_mm = 70, .mae_mm = 50, .completeness = 1}},
                           .worst_frames = {{.frame = 17, .stem = "17", .time_ns = 1305031102175304000, .rmse_mm = 9}},
                           .sensor_floor = SelfCheck::Floor{.rmse_mm = 2.5, .mae_mm = 1.5},
                           .seconds = 3.5};
  const std::string text = ToJson(check).dump();
  const absl::StatusOr<SelfCheck> read = ParseSelfCheck(text);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(ToJson(*read).dump(), text);
  EXPECT_EQ(read->summary, check.summary);
  EXPECT_EQ(read->pixels, check.pixels);
  EXPECT_EQ(read->methods[0].mae_mm, check.methods[0].mae_mm);
  EXPECT_EQ(read->methods[0].within_one_sigma, 0.7);
  EXPECT_FALSE(read->methods[1].edge_band_rmse_mm.has_value());
  EXPECT_EQ(read->worst_frames[0].time_ns, check.worst_frames[0].time_ns);
  EXPECT_EQ(read->sensor_floor->mae_mm, 1.5);

  const SelfCheck none = {.summary = "no self-check: too short", .reason = "too short"};
  EXPECT_EQ(ToJson(none).dump(), R"({"reason":"too short","summary":"no self-check: too short"})");
  EXPECT_EQ(ParseSelfCheck(ToJson(none).dump())->reason, "too short");
}

TEST(SelfCheckJson, RefusesWhatItDidNotWrite) {
  for (const char* const text : {"", "[]", "{}", R"({"summary":"s"})", R"({"summary":1,"reason":"r"})"}) {
    const absl::Status refused = ParseSelfCheck(text).status();
    EXPECT_TRUE(absl::IsInvalidArgument(refused)) << text;
    EXPECT_THAT(std::string(refused.message()), HasSubstr("self-check: "));
  }
}

}  // namespace
}  // namespace depthtween
