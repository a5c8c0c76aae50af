// upsample and task as programs: what a user and a server see of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "core/io/frame_list.h"
#include "core/io/result_folder.h"
#include "core/sandbox/sandbox.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::tools {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;
namespace fs = std::filesystem;

struct TaskFiles {
  std::string sequence, options, constants, out;

  std::vector<std::string> Arguments(const std::string& step) const {
    std::vector<std::string> words = {step, "--sequence", sequence, "--options", options, "--constants", constants};
    if (step != "prepare") words.insert(words.end(), {"--out", out});
    return words;
  }
  ToolResult Run(const std::string& step, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words = Arguments(step);
    words.insert(words.begin(), "task");
    words.insert(words.end(), more.begin(), more.end());
    return RunTool(words);
  }
};

TaskFiles MakeTask(const TemporaryFolder& scratch, const json& options) {
  TaskFiles files{.sequence = scratch / "recording",
                  .options = scratch / "options.json",
                  .constants = scratch / "constants.json",
                  .out = scratch / "task_out"};
  EXPECT_EQ(WriteFile(files.options, json({{"upsample", options}}).dump()), absl::OkStatus());
  return files;
}

std::vector<std::pair<std::string, std::string>> FrameFiles(const std::string& dir) {
  auto files = FilesBelow(dir);
  std::erase_if(files, [](const auto& file) { return file.first.find('/') == std::string::npos; });
  return files;
}

class UpsampleCommands : public testing::TestWithParam<std::string> {};

// The division into processes, batches and threads, and the order of the batches, must not show in a single byte.
TEST_P(UpsampleCommands, TasksGiveTheBitsOfUpsample) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 64, 48, 30);
  const ToolResult local = RunTool({"upsample", scratch / "recording", "-o", scratch / "out", "--method", GetParam()});
  ASSERT_EQ(local.exit_code, 0) << local.err;

  const TaskFiles task = MakeTask(scratch, {{"method", GetParam()}});
  ASSERT_EQ(task.Run("prepare").exit_code, 0);
  const json plan = json::parse(ReadFile(task.constants).value());
  const int intervals = static_cast<int>(plan.at("intervals").size());
  ASSERT_EQ(intervals, 5) << "held, three between depth frames, held";
  EXPECT_TRUE(plan.at("intervals")[0].at("held"));
  EXPECT_EQ(plan.at("frames")[3], json({{"index", 3}, {"time_ns", 12'500'000}, {"stem", "000003"}}));
  for (const auto& [first, count] : std::vector<std::pair<int, int>>{{3, 2}, {1, 2}, {0, 1}}) {
    const ToolResult batch =
        task.Run("intervals", {"--first", std::to_string(first), "--count", std::to_string(count)});
    ASSERT_EQ(batch.exit_code, 0) << batch.err;
  }
  const ToolResult assembled = task.Run("assemble");
  ASSERT_EQ(assembled.exit_code, 0) << assembled.err;

  const auto expected = FrameFiles(scratch / "out");
  ASSERT_EQ(expected.size(), 3U * 30U);
  EXPECT_EQ(FrameFiles(task.out), expected);
  for (const char* name : {"depth.txt", "camera.json"})
    EXPECT_EQ(ReadFile(JoinPath(task.out, name)).value(), ReadFile(JoinPath(scratch / "out", name)).value()) << name;
}

INSTANTIATE_TEST_SUITE_P(Methods, UpsampleCommands, testing::Values("ours", "linear", "flow-warp"),
                         [](const auto& method) {
                           std::string name = method.param;
                           std::erase(name, '-');
                           return name;
                         });

TEST(UpsampleCommand, ReportsWhatItDid) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 20);
  const ToolResult run =
      RunTool({"upsample", scratch / "recording", "-o", scratch / "out", "--method", "linear", "--key-every", "2"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json report = json::parse(ReadFile(scratch / "out/report.json").value());
  EXPECT_EQ(report.at("sequence"), scratch / "recording");
  EXPECT_EQ(report.at("options").at("key_every"), 2);
  EXPECT_EQ(report.at("keys"), 2);
  EXPECT_EQ(report.at("frames"), 20);
  EXPECT_EQ(report.at("held_frames"), 3) << "frames 0 and 1, and 19 after the depth frame at 18";
  for (const char* field : {"seconds", "stages", "constants", "warnings", "versions", "terminations"})
    EXPECT_TRUE(report.contains(field)) << field;
  EXPECT_FALSE(fs::exists(scratch / "out/rgb")) << "colour is not copied";
}

// A recording whose depth clock is ten minutes ahead and whose lists are in milliseconds is the same recording, once
// told: the same depth, and the same pictures from it.
TEST(UpsampleCommand, ClocksAndUnitsChangeNoDepth) {
  const TemporaryFolder scratch;
  const std::string recording = scratch / "recording", other = scratch / "other";
  WriteTinyRecording(recording, 32, 24, 12);
  fs::copy(recording, other, fs::copy_options::recursive);
  const auto rewrite = [&](const std::string& name, int64_t later_ns) {
    std::string text;
    for (const FrameRef& frame : ParseFrameList(ReadFile(recording + "/" + name).value()).frames)
      text += absl::StrFormat("%.6f %s\n", 1e-6 * static_cast<double>(frame.time_ns + later_ns), frame.path);
    EXPECT_EQ(WriteFile(other + "/" + name, text), absl::OkStatus());
  };
  rewrite("rgb.txt", 0);
  rewrite("depth.txt", 600'000'000'000);
  ASSERT_EQ(RunTool({"upsample", recording, "-o", scratch / "out", "--preset", "fast"}).exit_code, 0);
  const ToolResult refused = RunTool({"upsample", other, "-o", scratch / "none", "--preset", "fast"});
  EXPECT_NE(refused.exit_code, 0);
  // The first depth frame is two colour frames, of 1/240 s, later than the first colour frame.
  EXPECT_THAT(refused.err, HasSubstr("--clock=600008.333"));
  const ToolResult run =
      RunTool({"upsample", other, "-o", scratch / "other_out", "--preset", "fast", "--clock", "600000"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("warning: rgb.txt: its time stamps are taken for milliseconds"));
  EXPECT_EQ(FrameFiles(scratch / "other_out"), FrameFiles(scratch / "out"));
  const auto render = [&](const std::string& from, const std::string& to, std::vector<std::string> more) {
    more.insert(more.begin(), {"render", from, "-o", to, "--dof", "--focus-depth", "1"});
    const ToolResult rendered = RunTool(more);
    EXPECT_EQ(rendered.exit_code, 0) << rendered.err;
    return FilesBelow(to);
  };
  EXPECT_EQ(render(other, scratch / "other_dof", {"--preset", "fast", "--clock", "600000"}),
            render(recording, scratch / "dof", {"--preset", "fast"}));
}

// What was asked for must reach the pipeline: without the median the bits are others, and the report says so.
TEST(UpsampleCommand, PresetsAndPartsReachThePipeline) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 64, 48, 20);
  const auto depth_of = [&](const std::string& name, const std::vector<std::string>& flags) {
    std::vector<std::string> command = {"upsample", scratch / "recording", "-o", scratch / name};
    command.insert(command.end(), flags.begin(), flags.end());
    const ToolResult run = RunTool(command);
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return FilesBelow(scratch / (name + "/depth"));
  };
  const auto balanced = depth_of("balanced", {});
  EXPECT_EQ(depth_of("named", {"--preset", "balanced"}), balanced);
  EXPECT_NE(depth_of("fast", {"--preset", "fast"}), balanced);
  EXPECT_NE(depth_of("bare", {"--without", "median,propagation"}), balanced);
  const json options = json::parse(ReadFile(scratch / "bare/report.json").value()).at("options");
  EXPECT_EQ(options.at("without"), json({"median", "propagation"}));

  // The paper's choices, where the paper's solve is: each choice's effect is tested beside it (core/solve).
  const auto reference = depth_of("reference", {"--preset", "reference"});
  EXPECT_NE(depth_of("printed", {"--preset", "reference", "--literal", "short,rigid,kernels"}), reference);
  EXPECT_EQ(json::parse(ReadFile(scratch / "printed/report.json").value()).at("options").at("literal"),
            json({"short", "rigid", "kernels"}));
  const ToolResult misplaced = RunTool({"upsample", scratch / "recording", "-o", scratch / "x", "--literal", "short"});
  EXPECT_EQ(misplaced.exit_code, 1);
  EXPECT_THAT(misplaced.err, HasSubstr("options.literal is for preset 'reference' alone"));

  const ToolResult mixed =
      RunTool({"upsample", scratch / "recording", "-o", scratch / "x", "--method", "hold", "--preset", "fast"});
  EXPECT_EQ(mixed.exit_code, 1);
  EXPECT_THAT(mixed.err, HasSubstr("options.preset is for method 'ours' alone"));
  EXPECT_FALSE(fs::exists(scratch / "x"));
}

TEST(UpsampleCommand, ReplacesAResultOnlyWhenForced) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 12);
  const std::vector<std::string> command = {"upsample", scratch / "recording", "-o", scratch / "out", "--method",
                                            "hold"};
  ASSERT_EQ(RunTool(command).exit_code, 0);
  ASSERT_EQ(WriteFile(scratch / "out/depth/stale.png", "of an earlier run"), absl::OkStatus());
  ASSERT_EQ(WriteFile(scratch / "out/notes.txt", "mine"), absl::OkStatus());

  const ToolResult refused = RunTool(command);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.err, HasSubstr("use --force"));
  EXPECT_TRUE(fs::exists(scratch / "out/depth/stale.png"));

  std::vector<std::string> forced = command;
  forced.push_back("--force");
  EXPECT_EQ(RunTool(forced).exit_code, 0);
  EXPECT_FALSE(fs::exists(scratch / "out/depth/stale.png"));
  EXPECT_TRUE(fs::exists(scratch / "out/notes.txt"));
}

// A result has the same file names as a recording; --force must never cost anybody the latter.
TEST(UpsampleCommand, NeverWritesIntoARecording) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 12);
  const auto before = FilesBelow(scratch / "recording");
  const ToolResult run =
      RunTool({"upsample", scratch / "recording", "-o", scratch / "recording", "--method", "hold", "--force"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, HasSubstr("holds a recording"));
  EXPECT_EQ(FilesBelow(scratch / "recording"), before);
}

TEST(UpsampleCommand, ExitCodesTellUsageFromFailure) {
  EXPECT_EQ(RunTool({"--version"}).exit_code, 0);
  EXPECT_EQ(RunTool({"upsample", "--help"}).exit_code, 0);
  EXPECT_EQ(RunTool({}).exit_code, 2);
  EXPECT_EQ(RunTool({"paint"}).exit_code, 2);
  const ToolResult method = RunTool({"upsample", "x", "-o", "y", "--method", "magic"});
  EXPECT_EQ(method.exit_code, 2);
  EXPECT_THAT(method.err, HasSubstr("magic"));
  EXPECT_EQ(RunTool({"upsample", "x", "-o", "y", "--key-every", "0"}).exit_code, 2);
  EXPECT_EQ(RunTool({"upsample", "x", "-o", "y", "--preset", "turbo"}).exit_code, 2);
  const ToolResult part = RunTool({"upsample", "x", "-o", "y", "--without", "draw,luck"});
  EXPECT_EQ(part.exit_code, 2);
  EXPECT_THAT(part.err, HasSubstr("luck"));
  const ToolResult missing = RunTool({"upsample", "/no/such/folder", "-o", "/no/such/out"});
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_THAT(missing.err, HasSubstr("/no/such/folder"));
}

// A server learns of every frame and interval, and of a failure by its code.
TEST(TaskCommand, TellsItsProgress) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 20);
  const TaskFiles task = MakeTask(scratch, {{"method", "linear"}});
  ASSERT_EQ(task.Run("prepare").exit_code, 0);
  std::vector<std::string> words = task.Arguments("intervals");
  words.insert(words.end(), {"--first", "1", "--count", "1"});
  RunningTask running(words);
  std::vector<json> lines;
  for (std::string line = running.ReadLine(); !line.empty(); line = running.ReadLine())
    lines.push_back(json::parse(line));
  EXPECT_EQ(running.Wait(), 0);
  for (int frame = 2; frame < 10; ++frame) EXPECT_THAT(lines, Contains(json({{"frame", frame}, {"interval", 1}})));
  ASSERT_FALSE(lines.empty());
  EXPECT_EQ(lines.back().at("interval_done"), 1);
  EXPECT_EQ(lines.back().at("frames"), 8);
  const json report = json::parse(ReadFile(JoinPath(task.out, "interval_000001.json")).value());
  EXPECT_EQ(report.at("frames"), 8);

  std::vector<std::string> absent = task.Arguments("intervals");
  absent.insert(absent.end(), {"--first", "9", "--count", "1"});
  RunningTask failing(absent);
  const json error = json::parse(failing.ReadLine()).at("error");
  EXPECT_EQ(error.at("code"), "INVALID_ARGUMENT");
  EXPECT_THAT(error.at("message").get<std::string>(), HasSubstr("intervals 0 to 3"));
  EXPECT_EQ(failing.Wait(), 1);
}

// What the kernel says of a process that is at work. core/sandbox has its own tests of what that means.
TEST(TaskCommand, IsShutIn) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 64, 48, 30);
  const TaskFiles task = MakeTask(scratch, {{"preset", "best"}});
  ASSERT_EQ(task.Run("prepare").exit_code, 0);
  std::vector<std::string> words = task.Arguments("intervals");
  words.insert(words.end(), {"--first", "0", "--count", "3"});
  RunningTask running(words);
  ASSERT_NE(running.ReadLine(), "");
  std::stringstream text;
  text << std::ifstream("/proc/" + std::to_string(running.pid()) + "/status").rdbuf();
  const std::string status = text.str();
  EXPECT_THAT(status, HasSubstr("NoNewPrivs:\t1\n"));
  EXPECT_THAT(status, HasSubstr("CapEff:\t0000000000000000\n"));
  if (SupportedSandbox().system_calls) {
    EXPECT_THAT(status, HasSubstr("Seccomp:\t2\n"));
  }
  running.CloseProgress();
  EXPECT_NE(running.Wait(), 0) << "nobody hears it any more";
}

// Its files are those that the command line names: a link out of the recording leads nowhere.
TEST(TaskCommand, ReadsNoOtherFiles) {
  if (!SupportedSandbox().files) GTEST_SKIP() << "this kernel has no Landlock";
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 20);
  const TaskFiles task = MakeTask(scratch, {{"method", "hold"}});
  EXPECT_EQ(task.Run("prepare").exit_code, 0);
  fs::rename(scratch / "recording/camera.json", scratch / "camera.json");
  fs::create_symlink(scratch / "camera.json", scratch / "recording/camera.json");
  const ToolResult refused = task.Run("intervals", {"--first", "0", "--count", "1"});
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.err, HasSubstr("Permission denied"));
}

TEST(TaskCommand, AssembleNamesWhatIsMissing) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 20);
  const TaskFiles task = MakeTask(scratch, {{"method", "hold"}});
  ASSERT_EQ(task.Run("prepare").exit_code, 0);
  ASSERT_EQ(task.Run("intervals", {"--first", "0", "--count", "2"}).exit_code, 0);
  const ToolResult assembled = task.Run("assemble");
  EXPECT_EQ(assembled.exit_code, 1);
  EXPECT_THAT(assembled.err, HasSubstr("interval 2 has not been computed"));
  EXPECT_FALSE(fs::exists(task.out + "/report.json"));
}

// Scene flow is made at the end, frame by frame, and said so; a task that was killed meanwhile makes what is missing.
TEST(TaskCommand, AssembleTellsHowFarSceneFlowIs) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 64, 48, 12);
  const TaskFiles task = MakeTask(scratch, {{"preset", "fast"}, {"scene_flow", true}});
  ASSERT_EQ(task.Run("prepare").exit_code, 0);
  ASSERT_EQ(task.Run("intervals", {"--first", "0", "--count", "3"}).exit_code, 0);
  const auto stages = [&] {
    std::vector<std::string> said;
    RunningTask running(task.Arguments("assemble"));
    for (std::string line = running.ReadLine(); !line.empty(); line = running.ReadLine())
      said.push_back(json::parse(line).at("stage"));
    EXPECT_EQ(running.Wait(), 0);
    return said;
  };
  std::vector<std::string> expected;
  for (int done = 0; done <= 8; ++done) expected.push_back(absl::StrFormat("scene flow, frame %d of 8", done));
  EXPECT_EQ(stages(), expected) << "of the frames between depth frames 2 and 10";
  const auto whole = FilesBelow(task.out + "/sceneflow");
  ASSERT_EQ(whole.size(), 8U);
  fs::remove(task.out + "/sceneflow/000004.npz");
  EXPECT_EQ(stages(), std::vector<std::string>(expected.end() - 2, expected.end()));
  EXPECT_EQ(FilesBelow(task.out + "/sceneflow"), whole);
  EXPECT_EQ(json::parse(ReadFile(task.out + "/report.json").value()).at("scene_flow_frames"), 8);

  // Motion that is lost meanwhile is not taken for a frame that has none.
  fs::remove(task.out + "/motion/000003.npz");
  const ToolResult lost = task.Run("assemble");
  EXPECT_EQ(lost.exit_code, 1);
  EXPECT_THAT(lost.err, HasSubstr("interval 1: the motion of 8 frames was written, and that of 7 is there"));
}

// What a server makes may go anywhere: it says nothing of where the server keeps things, and whoever looks at it beside
// the recording has to say where that is.
TEST(TaskCommand, ResultsNameNoFolderOfTheServer) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 12);
  const TaskFiles task = MakeTask(scratch, {{"method", "hold"}});
  ASSERT_EQ(task.Run("prepare").exit_code, 0);
  ASSERT_EQ(task.Run("intervals", {"--first", "0", "--count", "3"}).exit_code, 0);
  ASSERT_EQ(task.Run("assemble").exit_code, 0);
  const std::string report = ReadFile(task.out + "/report.json").value();
  EXPECT_EQ(report.find(scratch.path()), std::string::npos) << report;
  const std::vector<std::string> look = {"preview", task.out, "-o", scratch / "look.png", "--frame", "3"};
  const ToolResult lost = RunTool(look);
  EXPECT_EQ(lost.exit_code, 1);
  EXPECT_THAT(lost.err, HasSubstr("name it with --sequence"));
  std::vector<std::string> told = look;
  told.insert(told.end(), {"--sequence", scratch / "recording"});
  const ToolResult shown = RunTool(told);
  EXPECT_EQ(shown.exit_code, 0) << shown.err;
}

// Slow enough to be caught in the middle on any machine: 900 frames of dense flow.
TaskFiles MakeLongTask(const TemporaryFolder& scratch) {
  WriteTinyRecording(scratch / "recording", 64, 48, 900);
  const TaskFiles task = MakeTask(scratch, {{"method", "flow-warp"}});
  EXPECT_EQ(task.Run("prepare").exit_code, 0);
  return task;
}

std::vector<std::string> AllIntervals(const TaskFiles& task) {
  const size_t count = json::parse(ReadFile(task.constants).value()).at("intervals").size();
  std::vector<std::string> words = task.Arguments("intervals");
  words.insert(words.end(), {"--first", "0", "--count", std::to_string(count)});
  return words;
}

// Every file there is a whole one: no temporary names, every depth frame readable with its companions.
void ExpectWholeFrames(const TaskFiles& task) {
  for (const auto& [name, bytes] : FilesBelow(task.out)) {
    const fs::path path = name;
    EXPECT_TRUE(path.extension() == ".png" || path.extension() == ".json") << name;
    if (path.parent_path() == "depth") {
      const auto frame = ReadResultFrame(task.out, path.stem(), 1000.0);
      EXPECT_TRUE(frame.ok()) << frame.status();
    }
  }
}

TEST(TaskCommand, StopsOnSigtermAndLeavesWholeFiles) {
  const TemporaryFolder scratch;
  const TaskFiles task = MakeLongTask(scratch);
  RunningTask running(AllIntervals(task));
  while (!json::parse(running.ReadLine()).contains("frame")) {
  }
  kill(running.pid(), SIGTERM);
  std::string last;
  for (std::string line = running.ReadLine(); !line.empty(); line = running.ReadLine()) last = line;
  EXPECT_EQ(running.Wait(), 1);
  EXPECT_EQ(json::parse(last).at("error").at("code"), "CANCELLED") << last;
  ExpectWholeFrames(task);
}

// A server that died leaves the reading end of the pipe closed.
TEST(TaskCommand, StopsWhenNobodyReadsItsProgress) {
  const TemporaryFolder scratch;
  const TaskFiles task = MakeLongTask(scratch);
  RunningTask running(AllIntervals(task));
  running.ReadLine();
  running.CloseProgress();
  EXPECT_EQ(running.Wait(), 1);
  ExpectWholeFrames(task);
}

TEST(TaskCommand, ValidatePrintsWhatIsWrongAndSucceeds) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 12);
  const ToolResult good = RunTool({"task", "validate", "--sequence", scratch / "recording"});
  ASSERT_EQ(good.exit_code, 0) << good.err;
  json answer = json::parse(good.out);
  EXPECT_EQ(answer.at("ok"), true);
  EXPECT_EQ(answer.at("camera").at("width"), 32);
  EXPECT_EQ(answer.at("color").size(), 12U);
  EXPECT_EQ(answer.at("depth")[1], json({{"time_ns", 41'666'666}, {"path", "depth/000001.png"}}));
  EXPECT_NEAR(answer.at("median_depth_m").get<double>(), 2.1, 0.2);

  const std::string damaged = scratch / "recording/depth/000001.png";
  ASSERT_EQ(WriteFile(damaged, ReadFile(damaged).value().substr(0, 60)), absl::OkStatus());
  const ToolResult bad = RunTool({"task", "validate", "--sequence", scratch / "recording"});
  EXPECT_EQ(bad.exit_code, 0) << "an invalid recording is an answer, not a failure";
  answer = json::parse(bad.out);
  EXPECT_EQ(answer.at("ok"), false);
  ASSERT_EQ(answer.at("violations").size(), 1U);
  EXPECT_EQ(answer.at("violations")[0].at("file"), "depth/000001.png");
  EXPECT_EQ(answer.at("violations")[0].at("code"), "DATA_LOSS");
}

}  // namespace
}  // namespace depthtween::tools
