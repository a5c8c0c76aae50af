#include "tests/core/tools/tool_process.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>

#include "core/io/file.h"
#include "core/io/sequence_folder.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

namespace fs = std::filesystem;

std::vector<char*> Argv(std::vector<std::string>& arguments) {
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  return argv;
}

int ExitCode(int wait_status) { return WIFEXITED(wait_status) ? WEXITSTATUS(wait_status) : -WTERMSIG(wait_status); }

}  // namespace

ToolResult RunTool(const std::vector<std::string>& arguments) {
  const TemporaryFolder scratch;
  std::vector<std::string> words = arguments;
  words.insert(words.begin(), DEPTHTWEEN_CORE_PROGRAM);
  const std::vector<char*> argv = Argv(words);
  const std::string out = scratch / "out", err = scratch / "err";
  const pid_t pid = fork();
  if (pid == 0) {
    dup2(open(out.c_str(), O_CREAT | O_WRONLY, 0600), STDOUT_FILENO);
    dup2(open(err.c_str(), O_CREAT | O_WRONLY, 0600), STDERR_FILENO);
    execv(argv[0], argv.data());
    _exit(127);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  return {.exit_code = ExitCode(status), .out = ReadFile(out).value_or(""), .err = ReadFile(err).value_or("")};
}

RunningTask::RunningTask(const std::vector<std::string>& arguments) {
  int ends[2] = {};
  if (pipe2(ends, O_CLOEXEC) != 0) std::abort();
  std::vector<std::string> words = arguments;
  words.insert(words.begin(), {DEPTHTWEEN_CORE_PROGRAM, "task"});
  words.insert(words.end(), {"--progress-fd", std::to_string(ends[1])});
  const std::vector<char*> argv = Argv(words);
  pid_ = fork();
  if (pid_ == 0) {
    fcntl(ends[1], F_SETFD, 0);
    execv(argv[0], argv.data());
    _exit(127);
  }
  close(ends[1]);
  progress_ = fdopen(ends[0], "r");
}

RunningTask::~RunningTask() {
  CloseProgress();
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    Wait();
  }
}

std::string RunningTask::ReadLine() {
  std::string line;
  for (int c = fgetc(progress_); c != EOF && c != '\n'; c = fgetc(progress_)) line += static_cast<char>(c);
  return line;
}

void RunningTask::CloseProgress() {
  if (progress_ != nullptr) fclose(progress_);
  progress_ = nullptr;
}

int RunningTask::Wait() {
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = -1;
  return ExitCode(status);
}

void WriteTinyRecording(const std::string& dir, int width, int height, int color_frames) {
  const Camera camera{.width = width,
                      .height = height,
                      .fx = static_cast<double>(width),
                      .fy = static_cast<double>(width),
                      .cx = width / 2.0,
                      .cy = height / 2.0};
  auto writer = SequenceWriter::Create(dir, camera, 1000.0);
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (int frame = 0; frame < color_frames; ++frame) {
    const int64_t time_ns = int64_t{1'000'000'000} * frame / 240;
    Image<Rgb8> color(width, height);
    Image<float> depth_m(width, height);
    const int left = width / 8 + frame * width / (2 * color_frames);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const bool square = x >= left && x < left + width / 4 && y >= height / 4 && y < height * 3 / 4;
        const int u = square ? x - left : x;
        const auto texture = static_cast<uint8_t>(80 + (u * 37 + y * 11) % 64);
        color(x, y) = square ? Rgb8{255, texture, 40} : Rgb8{30, texture, texture};
        depth_m(x, y) = square ? 1.0F : 2.0F + 0.01F * static_cast<float>(x);
      }
    }
    ASSERT_EQ(writer->AddColor(time_ns, color), absl::OkStatus());
    if (frame % 8 == 2) {
      ASSERT_EQ(writer->AddDepth(time_ns, depth_m), absl::OkStatus());
    }
  }
  ASSERT_EQ(writer->Finish(), absl::OkStatus());
}

std::vector<std::pair<std::string, std::string>> FilesBelow(const std::string& dir) {
  std::vector<std::pair<std::string, std::string>> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(dir))
    if (entry.is_regular_file())
      files.emplace_back(fs::relative(entry.path(), dir).string(), ReadFile(entry.path()).value_or("unreadable"));
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace depthtween
