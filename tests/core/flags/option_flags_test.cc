// Flags made from the lists of options. Expected documents and texts are written by hand.
#include "core/flags/option_flags.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>

#include "core/options/scene_flow_options.h"
#include "core/options/upsample_options.h"

namespace depthtween {
namespace {

using nlohmann::json;
using testing::HasSubstr;

json Parse(const std::vector<OptionSpec>& specs, std::vector<std::string> words) {
  CLI::App app;
  json document = json::object();
  AddOptionFlags(app, specs, document);
  std::reverse(words.begin(), words.end());  // as CLI11 wants them
  app.parse(words);
  return document;
}

TEST(OptionFlags, WriteWhatIsGivenAndNoMore) {
  EXPECT_EQ(Parse(UpsampleOptionSpecs(), {}), json::object());
  EXPECT_EQ(Parse(UpsampleOptionSpecs(), {"--key-every", "4", "--causal", "--without", "draw,median"}),
            (json{{"key_every", 4}, {"causal", true}, {"without", {"draw", "median"}}}));
  EXPECT_EQ(Parse(SceneFlowOptionSpecs(), {"--format", "flo,kitti", "--baseline", "0.5"}),
            (json{{"formats", {"flo", "kitti"}}, {"baseline_m", 0.5}}));
}

// A wrong word is a usage error, told before anything is read.
TEST(OptionFlags, RefuseWhatTheListRefuses) {
  const auto parse = [](std::vector<std::string> words) { return Parse(UpsampleOptionSpecs(), std::move(words)); };
  EXPECT_THROW(parse({"--preset", "turbo"}), CLI::ValidationError);
  EXPECT_THROW(parse({"--without", "draw,luck"}), CLI::ValidationError);
  EXPECT_THROW(parse({"--key-every", "0"}), CLI::ValidationError);
  EXPECT_THROW(parse({"--clock", "sundial"}), CLI::ValidationError);
  EXPECT_THROW(parse({"--key-every", "many"}), CLI::ConversionError);
  try {
    parse({"--preset", "turbo"});
  } catch (const CLI::ValidationError& error) {
    EXPECT_THAT(error.what(), HasSubstr("--preset = \"turbo\", must be one of: fast, balanced"));
  }
}

// A user reads help from the top: what only judges the method stands last.
TEST(OptionFlags, HelpEndsWithResearch) {
  CLI::App app;
  json document;
  AddOptionFlags(app, UpsampleOptionSpecs(), document);
  const std::string help = app.help();
  const size_t research = help.find("For research");
  ASSERT_NE(research, std::string::npos);
  for (const char* flag : {"--preset ", "--causal ", "--self-check ", "--clock ", "--scene-flow "})
    EXPECT_LT(help.find(flag), research) << flag;
  for (const char* flag : {"--without ", "--literal "}) {
    EXPECT_GT(help.find(flag), research) << flag;
    EXPECT_NE(help.find(flag), std::string::npos) << flag;
  }
}

TEST(OptionFlags, PresetHelpKnowsEveryPreset) {
  for (const std::string& preset : PresetNames()) EXPECT_THAT(PresetHelp(), HasSubstr("\n  " + preset + " "));
}

TEST(OptionFlags, ComeBackFromADocument) {
  EXPECT_EQ(FlagsOf(UpsampleOptionSpecs(), ToJson(UpsampleOptions())), "");
  const json document = ToJson(UpsampleOptions{.preset = "fast", .causal = true, .without = {"draw", "median"}});
  EXPECT_EQ(FlagsOf(UpsampleOptionSpecs(), document), "--preset fast --causal --without draw,median");
}

}  // namespace
}  // namespace depthtween
