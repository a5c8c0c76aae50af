// Runs one task in a child process and makes what it finishes durable.
#ifndef DEPTHTWEEN_SERVER_JOBS_TASK_RUNNER_H_
#define DEPTHTWEEN_SERVER_JOBS_TASK_RUNNER_H_

#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "server/jobs/input_check.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/task_host.h"
#include "server/jobs/task_protocol.h"
#include "server/store/data_directory.h"
#include "server/store/records.h"

namespace depthtween::server {

// How an attempt ended.
struct TaskOutcome {
  absl::Status error;                          // OK: the child did all it was told to
  bool stopped = false;                        // because it was told to stop: nobody's fault
  bool retry = false;                          // the error may go away by itself
  std::optional<ValidationResult> validation;  // of a validate task that ended well
  std::optional<SelfCheck> self_check;         // of a self-check task that ended well
  std::optional<JobPlan> plan;                 // of a prepare task that ended well
  // Of an assemble task that ended well, whose job has an output that is made of frames at the end: those that have it.
  std::optional<std::vector<int>> assembled;
  std::vector<FileChecksum> files;  // that an assemble task which ended well left in the job's folder
};

// What the runner tells while the child runs, on the runner's thread.
struct TaskEvents {
  std::function<void(std::string_view stage)> on_stage;
  std::function<void(int checked, int of)> on_checked;
  // The frames of one interval, or their pictures, are in the job's out folder, durable; `files` are all that came with
  // them. An error stops the child.
  std::function<absl::Status(const PlannedInterval& interval, double seconds, const std::vector<FileChecksum>& files)>
      on_interval;
};

class TaskRunner {
 public:
  // Borrows `directory`, `store` and `damage`.
  // `host` may be null: each child is then started as a program.
  TaskRunner(const DataDirectory& directory, Store& store, DamageLog& damage, const JobManagerOptions& options,
             TaskHost* host = nullptr)
      : directory_(directory), store_(store), inputs_(directory, store, damage), options_(options), host_(host) {}

  // Returns when the child has ended. `job` is for all but validate tasks.
  // Threads: may be called concurrently, for different tasks. The child dies with the calling thread, or with the host.
  TaskOutcome Run(const Task& task, const JobRecord& job, const std::stop_token& stop, const TaskEvents& events);

 private:
  // Run, but for its verdict on the error that is returned. Fills the outcome's other fields.
  absl::Status Attempt(const Task& task, const JobRecord& job, const std::stop_token& stop, const TaskEvents& events,
                       TaskOutcome& outcome);
  // Writes what the child reads and says where everything is.
  absl::StatusOr<TaskPaths> WriteOrder(const Task& task, const JobRecord& job);
  // Of a child that ended well: reads what it answered and makes durable what it left.
  absl::Status TakeAnswer(const Task& task, const JobRecord& job, const TaskPaths& paths, TaskOutcome& outcome);
  // Of a validate task: if its sequence is an archive, puts the files in its place. Sets outcome.validation, and
  // changes nothing, if the archive is not in order.
  absl::Status UnpackArchive(const Task& task, const std::stop_token& stop, TaskOutcome& outcome);
  std::string ConstantsFile(const std::string& job_id) const;
  // Returns the files that it moved.
  absl::StatusOr<std::vector<FileChecksum>> MoveInterval(const Task& task, const JobRecord& job,
                                                         const PlannedInterval& interval);
  // What an assemble task left, but for what was there before.
  absl::StatusOr<std::vector<FileChecksum>> FilesAssembled(const JobRecord& job, const std::vector<int>& frames);
  // Makes what later tasks find on the disk durable, before the plan is recorded.
  absl::Status MakeResultFolders(const JobRecord& job);
  // Which frames have a file of the output that is made at the end; nullopt if there is no such output.
  absl::StatusOr<std::optional<std::vector<int>>> FramesAssembled(const JobRecord& job);
  // The plan of a job whose depth another one has, with that depth in its own result.
  absl::StatusOr<JobPlan> TakeOverDepth(const JobRecord& job);

  const DataDirectory& directory_;
  Store& store_;
  InputCheck inputs_;
  const JobManagerOptions options_;
  TaskHost* const host_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_TASK_RUNNER_H_
