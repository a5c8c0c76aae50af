#include "client/cli/render_flags.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace depthtween::cli {
namespace {

// What the words of a command line come to.
absl::StatusOr<std::vector<v1::RenderOptions>> Parse(std::vector<std::string> words) {
  CLI::App app;
  RenderFlags flags;
  AddRenderFlags(app, flags);
  std::reverse(words.begin(), words.end());  // as CLI11 wants them
  app.parse(words);
  return RendersOf(flags, v1::RenderOptions::CONTAINER_MKV);
}

TEST(RenderFlags, SayWhatTheServerIsAsked) {
  const auto renders = Parse({"--dof", "--fstop", "1.4", "--focus-keys", "0:1.2,60:4", "--dof-method", "kraus",
                              "--stereo", "--format", "anaglyph-half-colour", "--no-floating-window"});
  ASSERT_TRUE(renders.ok()) << renders.status();
  ASSERT_EQ(renders->size(), 2U);
  const v1::DepthOfField& dof = renders->at(0).depth_of_field();
  EXPECT_EQ(dof.fstop(), 1.4);
  EXPECT_FALSE(dof.has_focal_mm());  // unset is not zero: the server has its own default
  EXPECT_EQ(dof.method(), v1::DepthOfField::METHOD_KRAUS);
  ASSERT_EQ(dof.focus().keys().keys_size(), 2);
  EXPECT_EQ(dof.focus().keys().keys(1).frame(), 60);
  EXPECT_EQ(dof.focus().keys().keys(1).depth_m(), 4.0);
  const v1::Stereo& stereo = renders->at(1).stereo();
  EXPECT_EQ(stereo.format(), v1::Stereo::FORMAT_ANAGLYPH_HALF_COLOUR);
  EXPECT_TRUE(stereo.has_floating_window() && !stereo.floating_window());
  EXPECT_EQ(renders->at(1).container(), v1::RenderOptions::CONTAINER_MKV);
}

TEST(RenderFlags, NothingAskedIsNothingRendered) { EXPECT_TRUE(Parse({})->empty()); }

// An option without its product would silently do nothing.
TEST(RenderFlags, RefuseOptionsOfWhatIsNotRendered) {
  EXPECT_TRUE(absl::IsInvalidArgument(Parse({"--stereo", "--fstop", "2"}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Parse({"--dof", "--baseline", "0.06"}).status()));
}

TEST(RenderFlags, RefuseWhatDoesNotRead) {
  EXPECT_THROW(Parse({"--dof", "--focus-track", "0,320"}), CLI::ValidationError);
  EXPECT_THROW(Parse({"--dof", "--focus-keys", "0-1.2"}), CLI::ValidationError);
  EXPECT_THROW(Parse({"--stereo", "--format", "sideways"}), CLI::ValidationError);
}

}  // namespace
}  // namespace depthtween::cli
