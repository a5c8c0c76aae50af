// The steps of an upsampling or a scene flow, as `depthtween-core task` runs them in processes of their own.
#ifndef DEPTHTWEEN_CORE_SESSION_TASKS_H_
#define DEPTHTWEEN_CORE_SESSION_TASKS_H_

#include <cstdint>
#include <functional>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>

#include "core/base/status.h"

namespace depthtween {

// Paths of files and folders, and which part of the work. Each task reads those of its flags.
struct TaskArguments {
  std::string sequence, options, constants, out, result, render, self_check;
  int first = 0, count = 0, frame = 0, threads = 1;
  int64_t max_pixels = std::numeric_limits<int64_t>::max();  // of all frames of the sequence together
  // Of `unpack`: the archive's name in the sequence folder, and what may come out of it.
  std::string archive;
  int max_files = std::numeric_limits<int>::max();
  int64_t max_bytes = std::numeric_limits<int64_t>::max();
  bool keep_motion = false;
};

// A task that tells of nothing for long is taken for one that hangs. So every task has one of the two said at each
// frame or stage. Threads: both are called from several threads at once.
struct Task {
  const TaskArguments& arguments;
  std::stop_token stop;
  std::function<void(const nlohmann::json& line)> progress;
  std::function<void()> alive;  // some work was done that is not worth a line; cheap
};

// Decodes every frame; says what is wrong, and what the recording holds.
absl::StatusOr<nlohmann::json> ValidateTask(const Task& task);
// Unpacks a sequence that came as an archive to `out`, and says what is wrong with it.
absl::StatusOr<nlohmann::json> UnpackTask(const Task& task);
// Writes `constants`: what is decided once per clip.
absl::Status PrepareTask(const Task& task);
absl::Status SelfCheckTask(const Task& task);
// Computes intervals `first` to `first + count - 1`, and leaves a report of each beside its frames.
absl::Status IntervalsTask(const Task& task);
// Says of an order, before it is taken, whether the recording has the pairs of frames that a scene flow needs, and what
// renders need and leave.
absl::Status PlanTask(const Task& task);
absl::Status RenderTask(const Task& task);
absl::Status RenderFrameTask(const Task& task);
// Ends a result whose intervals are all there.
absl::Status AssembleTask(const Task& task);

// What a task writes as a file.
std::string Dump(const nlohmann::json& value);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_TASKS_H_
