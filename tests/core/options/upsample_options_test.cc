// Documents of upsamplings. Defaults, rules and messages are written by hand from the header and the help.
#include "core/options/upsample_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "absl/strings/str_join.h"
#include "core/options/field_error.h"

namespace depthtween {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

absl::Status StatusOf(const char* document) { return ParseUpsampleOptions(json::parse(document)).status(); }

// The message must name the field, its value and the rule: by it a user fixes the file.
TEST(UpsampleOptions, WrongOnesAreNamed) {
  const auto message = [](const char* document) { return std::string(StatusOf(document).message()); };
  EXPECT_THAT(message(R"({"method":"magic"})"), HasSubstr("options.method = \"magic\", must be one of: ours, hold"));
  EXPECT_THAT(message(R"({"method":3})"), HasSubstr("options.method = 3, must be one of"));
  EXPECT_THAT(message(R"({"key_every":0})"), HasSubstr("options.key_every = 0, must be 1 to 100000"));
  EXPECT_THAT(message(R"({"key_every":2147483647})"), HasSubstr("options.key_every = 2147483647, must be 1 to 100000"));
  EXPECT_THAT(message(R"({"key_every":1.5})"), HasSubstr("options.key_every = 1.5, must be a whole number"));
  EXPECT_THAT(message(R"({"key_every":4294967297})"), HasSubstr("options.key_every = 4294967297"));
  EXPECT_THAT(message(R"({"causal":1})"), HasSubstr("options.causal = 1, must be true or false"));
  EXPECT_THAT(message(R"({"clock":"sundial"})"),
              HasSubstr("options.clock 'sundial', must be stamps, index, estimate, or"));
  EXPECT_THAT(message(R"({"clock":"1,2,3"})"), HasSubstr("options.clock "));
  EXPECT_THAT(message(R"({"clock":"0,2e5"})"), HasSubstr("ClockModel.drift_ppm = 200000"));
  EXPECT_THAT(message(R"({"preset":"turbo"})"),
              HasSubstr("options.preset = \"turbo\", must be one of: " + absl::StrJoin(PresetNames(), ", ")));
  EXPECT_THAT(message(R"({"without":["draw","luck"]})"),
              HasSubstr("options.without has \"luck\", must be some of: " + absl::StrJoin(PartNames(), ", ")));
  EXPECT_THAT(message(R"({"without":"draw"})"), HasSubstr("options.without = \"draw\", must be a list of strings"));
  EXPECT_THAT(message(R"({"preset":"reference","literal":["rigid","luck"]})"),
              HasSubstr("options.literal has \"luck\", must be some of: " + absl::StrJoin(LiteralNames(), ", ")));
  EXPECT_THAT(message("[]"), HasSubstr("options must be a JSON object"));
  // How a run is made is no part of what it computes.
  EXPECT_THAT(message(R"({"threads":2})"), HasSubstr("options.threads is not known: the options are preset, "));
}

// A server passes the field on to whoever ordered the job.
TEST(UpsampleOptions, WrongOnesNameTheirFieldToPrograms) {
  const auto field = [](const char* document) { return FieldOf(StatusOf(document)); };
  EXPECT_EQ(field(R"({"preset":"turbo"})"), "options.preset");
  EXPECT_EQ(field(R"({"without":["luck"]})"), "options.without");
  EXPECT_EQ(field(R"({"clock":"sundial"})"), "options.clock");
  EXPECT_EQ(field(R"({"thread":2})"), "options.thread");
  EXPECT_EQ(FieldOf(ParseUpsampleOptions(json::parse(R"({"causal":2})"), "job.options").status()),
            "job.options.causal");
  EXPECT_EQ(FieldOf(Validate({.threads = -1})), "options.threads");
  EXPECT_EQ(FieldOf(Validate({.threads = kMaxThreads + 1})), "options.threads");
}

// An option that would change nothing is a mistake: baselines have neither presets nor stages.
TEST(UpsampleOptions, GoTogetherOrAreRefused) {
  const auto message = [](const UpsampleOptions& options) { return std::string(Validate(options).message()); };
  EXPECT_THAT(message({.method = "hold", .preset = "fast"}),
              HasSubstr("options.preset is for method 'ours' alone, and the method is 'hold'"));
  EXPECT_THAT(message({.method = "linear", .without = {"draw"}}), HasSubstr("options.without is for method 'ours'"));
  EXPECT_THAT(message({.method = "linear", .literal = {"rigid"}}), HasSubstr("options.literal is for method 'ours'"));
  EXPECT_THAT(message({.method = "linear", .self_check = true}), HasSubstr("options.self_check is for method 'ours'"));
  EXPECT_THAT(message({.method = "linear", .causal = true}), HasSubstr("options.causal is for method 'ours'"));
  EXPECT_THAT(message({.method = "linear", .scene_flow = true}), HasSubstr("options.scene_flow is for method 'ours'"));
  EXPECT_THAT(message({.preset = "best", .literal = {"rigid"}}),
              HasSubstr("options.literal is for preset 'reference' alone, and the preset is 'best'"));
  EXPECT_THAT(message({.scene_flow = true, .causal = true}), HasSubstr("options.scene_flow does not go with causal"));
  EXPECT_EQ(message({.preset = "fast", .causal = true, .self_check = true, .without = {"draw"}}), "");
}

TEST(UpsampleOptions, SurviveTheDocument) {
  const UpsampleOptions options{.key_every = 8,
                                .clock = "4,1000",
                                .preset = "reference",
                                .causal = true,
                                .self_check = true,
                                .without = {"draw", "median"},
                                .literal = {"rigid"}};
  const auto parsed = ParseUpsampleOptions(ToJson(options));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(ToJson(*parsed), ToJson(options));
  EXPECT_THAT(parsed->without, ElementsAre("draw", "median"));
  const auto defaults = ParseUpsampleOptions(json::object());
  ASSERT_TRUE(defaults.ok()) << defaults.status();
  EXPECT_EQ(ToJson(*defaults), ToJson(UpsampleOptions()));
  EXPECT_EQ(defaults->preset, "balanced");
}

}  // namespace
}  // namespace depthtween
