// One child process: started with limits, listened to line by line, ended without fail.
#ifndef DEPTHTWEEN_SERVER_JOBS_CHILD_PROCESS_H_
#define DEPTHTWEEN_SERVER_JOBS_CHILD_PROCESS_H_

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "core/launch/launch.h"
#include "server/jobs/task_host.h"

namespace depthtween::server {

struct ChildSpec {
  std::vector<std::string> arguments;  // [0] is the program's path; "--progress-fd 3" reaches the pipe
  TaskHost* host = nullptr;            // of that program, if there is one: it launches the child
  std::string folder;                  // of this attempt: gets the files "stdout", "stderr" and "child" (who it is)
  int64_t memory_bytes = 0;            // RLIMIT_DATA; 0 = none
  int64_t file_bytes = 0;              // RLIMIT_FSIZE; 0 = none
  int64_t cpu_seconds = 0;             // RLIMIT_CPU, over all of its threads; 0 = none
  absl::Duration grace = absl::Seconds(1);
  absl::Duration time_limit = absl::InfiniteDuration();   // of its life; then it is stopped
  absl::Duration stall_limit = absl::InfiniteDuration();  // without a line from it; then it is stopped
};

struct ChildOutcome {
  bool stopped = false;      // because `stop` fired, on_line asked for it, its time was over, or it stalled
  bool timed_out = false;    // its time was over
  bool stalled = false;      // it said nothing for too long
  int exit_code = -1;        // -1 if a signal ended it
  int signal = 0;            // 0 if it exited
  std::string error_output;  // the end of its stderr, at most 4 KiB
  // "exit code 3" or "killed by SIGSEGV (Segmentation fault)"
  std::string Describe() const;
};

// Runs a child in its own process group and returns when it has ended and every process of its group was killed. It has
// none of this process's environment, none of its descriptors but what `folder` and `on_line` are for, and never gains
// privileges by what it starts.
// `on_line` gets each line it writes to descriptor 3, on this thread; returning false ends the child. Lines beyond 64
// KiB are cut. When `stop` fires: SIGTERM to the group, SIGKILL after the grace, which ends one that is suspended
// (SIGSTOP) too. The child dies with the *thread* that called this (PR_SET_PDEATHSIG is bound to it), or with the host
// that launched it; hence with this process. Errors: only when the child could not be started.
absl::StatusOr<ChildOutcome> RunChild(const ChildSpec& spec, const std::stop_token& stop,
                                      const std::function<bool(std::string_view line)>& on_line);

// What RunChild does without a host: a child of this thread. `files` are duplicated. The caller waits for it.
absl::StatusOr<pid_t> StartProgram(const std::vector<std::string>& arguments, const LaunchLimits& limits,
                                   const LaunchFiles& files);

// Kills the process group that a dead server left in `folder`, if it still lives and is the same one (by start time).
void KillLeftChild(const std::string& folder);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_CHILD_PROCESS_H_
