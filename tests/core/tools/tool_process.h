// Runs the program depthtween-core as a child process, as its users do.
#ifndef DEPTHTWEEN_TESTS_CORE_TOOLS_TOOL_PROCESS_H_
#define DEPTHTWEEN_TESTS_CORE_TOOLS_TOOL_PROCESS_H_

#include <sys/types.h>

#include <cstdio>
#include <string>
#include <vector>

namespace depthtween {

struct ToolResult {
  int exit_code = -1;  // or -signal
  std::string out, err;
};

// Runs to the end.
ToolResult RunTool(const std::vector<std::string>& arguments);

// A `task` with a progress pipe whose reading end is ours.
class RunningTask {
 public:
  explicit RunningTask(const std::vector<std::string>& arguments);
  ~RunningTask();
  RunningTask(const RunningTask&) = delete;
  RunningTask& operator=(const RunningTask&) = delete;

  pid_t pid() const { return pid_; }
  // The next progress line without its end, or "" after the last.
  std::string ReadLine();
  void CloseProgress();
  // Exit code, or -signal.
  int Wait();

 private:
  pid_t pid_ = -1;
  FILE* progress_ = nullptr;
};

// A recording of `color_frames` frames at 240 per second with a depth frame at every eighth of them, beginning at frame
// 2 so that some frames come before the first key: a bright square passes in front of a slanted wall.
void WriteTinyRecording(const std::string& dir, int width, int height, int color_frames);

// The bytes of every regular file below `dir`, by path relative to it, sorted.
std::vector<std::pair<std::string, std::string>> FilesBelow(const std::string& dir);

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_TOOLS_TOOL_PROCESS_H_
