// The lists of options: what must hold for every option of every list, so that a new one is complete or told of here.
#include "core/options/option.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <set>

#include "core/options/render_option_list.h"
#include "core/options/scene_flow_options.h"
#include "core/options/upsample_options.h"

namespace depthtween {
namespace {

using nlohmann::json;

struct NamedList {
  const char* name;
  const std::vector<OptionSpec>& (*specs)();
};

class OptionLists : public testing::TestWithParam<NamedList> {};

TEST_P(OptionLists, AreComplete) {
  ASSERT_FALSE(GetParam().specs().empty());
  std::set<std::string> names, flags;
  for (const OptionSpec& spec : GetParam().specs()) {
    EXPECT_THAT(spec.name, testing::MatchesRegex("[a-z][a-z0-9_]*"));
    EXPECT_THAT(spec.Flag(), testing::MatchesRegex("--[a-z][a-z0-9-]*")) << spec.name;
    EXPECT_TRUE(names.insert(spec.name).second) << spec.name << " stands twice";
    EXPECT_TRUE(flags.insert(spec.Flag()).second) << spec.Flag() << " stands twice";
    EXPECT_FALSE(spec.help.empty()) << spec.name;
    EXPECT_EQ(spec.placeholder.empty(), spec.type == OptionType::kFlag) << spec.name;
    const bool has_words = spec.type == OptionType::kWord || spec.type == OptionType::kWords;
    EXPECT_EQ(spec.words.empty(), !has_words) << spec.name;
    EXPECT_EQ(spec.check != nullptr, spec.type == OptionType::kText) << spec.name;
    const bool has_range = spec.type == OptionType::kInteger || spec.type == OptionType::kNumber;
    EXPECT_EQ(spec.min < spec.max, has_range) << spec.name;
    // Renders have their defaults where they are read (core/session/render_options.h).
    if (!spec.default_value.is_null()) {
      EXPECT_TRUE(CheckOption(spec, spec.default_value, spec.name).ok()) << spec.name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, OptionLists,
                         testing::Values(NamedList{"Upsample", UpsampleOptionSpecs},
                                         NamedList{"SceneFlow", SceneFlowOptionSpecs},
                                         NamedList{"DepthOfField", DepthOfFieldOptionSpecs},
                                         NamedList{"Stereo", StereoOptionSpecs}),
                         [](const auto& info) { return info.param.name; });

// Rules by hand: one value at each end, and one beyond.
TEST(CheckOption, RangesHaveEnds) {
  const OptionSpec whole{.name = "n", .min = 1, .max = 3, .type = OptionType::kInteger};
  for (const json& good : {json(1), json(3)}) EXPECT_TRUE(CheckOption(whole, good, "n").ok()) << good;
  for (const json& bad : {json(0), json(4), json(2.5), json("2"), json(true), json(nullptr)})
    EXPECT_FALSE(CheckOption(whole, bad, "n").ok()) << bad;
  const OptionSpec number{.name = "x", .min = 0.5, .max = 2, .type = OptionType::kNumber};
  for (const json& good : {json(0.5), json(1), json(2.0)}) EXPECT_TRUE(CheckOption(number, good, "x").ok()) << good;
  for (const json& bad : {json(0.4), json(2.1), json(std::nan("")), json("1")})
    EXPECT_FALSE(CheckOption(number, bad, "x").ok()) << bad;
}

// A message goes to terminals and logs: what a stranger sent must not flood them or break their text.
TEST(CheckOption, MessagesStayShortAndReadable) {
  const OptionSpec word{.name = "w", .words = {"a"}, .type = OptionType::kWord};
  const absl::Status status = CheckOption(word, "\xff" + std::string(100'000, 'x'), "w");
  EXPECT_LT(status.message().size(), 300U);
  EXPECT_EQ(status.message().find('\xff'), absl::string_view::npos);
}

}  // namespace
}  // namespace depthtween
