// Flags of renders. Expected documents are written by hand from core/session/render_options.h.
#include "core/flags/render_flags.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <string>
#include <vector>

namespace depthtween {
namespace {

// What the words of a command line come to.
absl::StatusOr<std::vector<nlohmann::json>> Parse(std::vector<std::string> words) {
  CLI::App app;
  RenderFlags flags;
  AddRenderFlags(app, flags);
  std::reverse(words.begin(), words.end());  // as CLI11 wants them
  app.parse(words);
  return RendersOf(flags, "mkv");
}

TEST(RenderFlags, WriteTheDocument) {
  const auto renders = Parse({"--dof", "--fstop", "1.4", "--focus-keys", "0:1.2,60:4", "--dof-method", "kraus",
                              "--stereo", "--format", "anaglyph-half-colour", "--no-floating-window"});
  ASSERT_TRUE(renders.ok()) << renders.status();
  ASSERT_EQ(renders->size(), 2U);
  EXPECT_EQ(renders->at(0).dump(),
            R"({"container":"mkv","depth_of_field":{"focus":{"keys":{"keys":[{"depth_m":1.2,"frame":0},)"
            R"({"depth_m":4.0,"frame":60}]}},"fstop":1.4,"method":"kraus"}})");
  EXPECT_EQ(renders->at(1).dump(),
            R"({"container":"mkv","stereo":{"floating_window":false,"format":"anaglyph-half-colour"}})");
}

TEST(RenderFlags, NothingAskedIsNothingRendered) { EXPECT_TRUE(Parse({})->empty()); }

// An option without its product would silently do nothing.
TEST(RenderFlags, RefuseOptionsOfWhatIsNotRendered) {
  EXPECT_TRUE(absl::IsInvalidArgument(Parse({"--stereo", "--fstop", "2"}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Parse({"--dof", "--baseline", "0.06"}).status()));
}

// The document says one focus, the wire can carry no more: of two, one would be lost.
TEST(RenderFlags, RefuseTwoFocuses) {
  EXPECT_TRUE(absl::IsInvalidArgument(Parse({"--dof", "--focus-depth", "2", "--focus-pixel", "0,3,4"}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Parse({"--dof", "--focus-depth", "2", "--focus-easing", "linear"}).status()));
  EXPECT_TRUE(Parse({"--dof", "--focus-easing", "linear", "--focus-keys", "0:1.2,60:4"}).ok());
}

TEST(RenderFlags, RefuseWhatDoesNotRead) {
  EXPECT_THROW(Parse({"--dof", "--focus-track", "0,320"}), CLI::ValidationError);
  EXPECT_THROW(Parse({"--dof", "--focus-keys", "0-1.2"}), CLI::ValidationError);
  EXPECT_THROW(Parse({"--dof", "--focus-depth", "inf"}), CLI::ValidationError);  // JSON would have null for it
  EXPECT_THROW(Parse({"--dof", "--fstop", "nan"}), CLI::ValidationError);
  EXPECT_THROW(Parse({"--stereo", "--format", "sideways"}), CLI::ValidationError);
}

}  // namespace
}  // namespace depthtween
