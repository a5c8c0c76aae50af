// synth as a program: what a user sees of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "core/io/file.h"
#include "core/io/sequence_folder.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::tools {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

std::vector<std::string> Small(const std::string& scene, const std::string& out,
                               const std::vector<std::string>& more = {}, int frames = 5) {
  std::vector<std::string> words = {"synth", scene, "-o", out, "--size", "64x48", "--depth-fps", "120"};
  words.insert(words.end(), {"--frames", std::to_string(frames)});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

TEST(SynthCommand, WritesARecordingThatChecksOut) {
  const TemporaryFolder scratch;
  const ToolResult result =
      RunTool(Small("bounce", scratch / "clip", {"--time-offset-ms", "1.5", "--drift-ppm", "100"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("5 colour frames at 240 fps and 3 depth frames at 120 fps, 64x48"));
  const auto check = CheckSequenceFolder(scratch / "clip");
  ASSERT_TRUE(check.ok());
  EXPECT_TRUE(check->ok());
  EXPECT_EQ(check->sequence.depth[0].time_ns, 1500000);
  EXPECT_TRUE(FileExists(scratch / "clip/gt/flow_key/fwd_000000_000001.png"));
}

TEST(SynthCommand, ReplacesARecordingOnlyWhenTold) {
  const TemporaryFolder scratch;
  ASSERT_EQ(RunTool(Small("still", scratch / "clip")).exit_code, 0);
  const auto before = FilesBelow(scratch / "clip");
  const ToolResult refused = RunTool(Small("bounce", scratch / "clip"));
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.err, HasSubstr("is not empty: name another folder, or use --force"));
  EXPECT_EQ(FilesBelow(scratch / "clip"), before);

  ASSERT_EQ(WriteFile(scratch / "clip/notes.txt", "mine"), absl::OkStatus());
  const ToolResult forced = RunTool(Small("bounce", scratch / "clip", {"--force", "--no-truth"}, /*frames=*/3));
  ASSERT_EQ(forced.exit_code, 0) << forced.err;
  EXPECT_FALSE(fs::exists(scratch / "clip/gt")) << "no truth of the earlier recording survives";
  EXPECT_FALSE(fs::exists(scratch / "clip/rgb/000004.jpg"));
  EXPECT_EQ(*ReadFile(scratch / "clip/notes.txt"), "mine");
}

// A wrong command line costs nothing: it is refused before --force removes anything.
TEST(SynthCommand, SaysWhatIsWrongBeforeItTouchesAnything) {
  const TemporaryFolder scratch;
  ASSERT_EQ(RunTool(Small("still", scratch / "clip")).exit_code, 0);
  const auto before = FilesBelow(scratch / "clip");
  const auto refusal = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = {"synth", "kick", "-o", scratch / "clip", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    const ToolResult result = RunTool(words);
    EXPECT_EQ(result.exit_code, 2);
    return result.err;
  };
  EXPECT_THAT(refusal({"--size", "512"}), HasSubstr("--size = '512', must be width x height"));
  EXPECT_THAT(refusal({"--size", "64x48x3"}), HasSubstr("--size = '64x48x3'"));
  EXPECT_THAT(refusal({"--depth-fps", "500"}),
              HasSubstr("depth_fps = 500, must be above 0 and at most color_fps (240)"));
  EXPECT_THAT(refusal({"--frames", "0"}), HasSubstr("frames = 0"));
  EXPECT_THAT(refusal({"--noise", "loud"}), HasSubstr("--noise"));
  EXPECT_THAT(RunTool({"synth", "nowhere", "-o", scratch / "x"}).err, HasSubstr("nowhere not in {bounce,kick"));
  EXPECT_EQ(FilesBelow(scratch / "clip"), before);
}

TEST(SynthCommand, HelpSaysWhatHappensInEachScene) {
  const ToolResult help = RunTool({"synth", "--help"});
  EXPECT_EQ(help.exit_code, 0);
  for (const char* phrase : {"bounce     balls bounce", "kick       a figure kicks", "cloth      a flag waves",
                             "turntable  objects turn", "pan        a hand-held camera", "still      nothing moves"})
    EXPECT_THAT(help.out, HasSubstr(phrase));
}

}  // namespace
}  // namespace depthtween::tools
