// Short tasks that a caller waits for: planning a job, rendering a single frame. Each is a child process with little
// time. A few run at a time, beside the workers, and a bounded number waits.
#ifndef DEPTHTWEEN_SERVER_JOBS_ERRANDS_H_
#define DEPTHTWEEN_SERVER_JOBS_ERRANDS_H_

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/jobs/task_host.h"
#include "server/store/data_directory.h"

namespace depthtween::server {

struct ErrandOptions {
  std::string core_program;
  TaskHost* host = nullptr;  // of it, if there is one
  int threads = 2;           // errands that run at the same time, > 0
  int max_waiting = 32;      // beyond them
  absl::Duration time_limit = absl::Seconds(30);
  absl::Duration grace = absl::Seconds(1);
  int64_t child_memory_bytes = 0;  // 0 = no limit
  int64_t child_file_bytes = 0;
};

// What a child is asked: `depthtween-core task <arguments> --options <file with options> --out <answer>`.
struct ErrandOrder {
  std::vector<std::string> arguments;
  std::string options;              // JSON
  std::string field_prefix;         // put before the field that an InvalidArgument of the child names
  std::string job_id, sequence_id;  // whose files it reads
};

// One errand in progress. Destroying it stops it.
class Errand {
 public:
  ~Errand();
  Errand(const Errand&) = delete;
  Errand& operator=(const Errand&) = delete;

  // The child's answer, or why there is none; nullopt while it runs or waits. Returned once.
  std::optional<absl::StatusOr<std::string>> TakeAnswer();

 private:
  friend class Errands;
  struct State;
  explicit Errand(std::shared_ptr<State> state);
  const std::shared_ptr<State> state_;
};

// Threads: all methods may be called concurrently.
class Errands {
 public:
  // Borrows `directory`.
  Errands(DataDirectory& directory, const ErrandOptions& options);
  // As Stop, and waits until nothing runs any more.
  ~Errands();

  // Stops what runs and what waits, and refuses what comes later: all are answered Unavailable (SERVER_STOPPING).
  // Returns at once.
  void Stop();
  // ResourceExhausted (SERVER_BUSY) when too many wait. `on_done` may be empty.
  absl::StatusOr<std::unique_ptr<Errand>> Start(const ErrandOrder& order, std::function<void()> on_done);
  // Start, and wait for the answer.
  absl::StatusOr<std::string> Run(const ErrandOrder& order);

 private:
  void Work(const std::stop_token& stop);
  absl::StatusOr<std::string> RunOne(const ErrandOrder& order, const std::stop_token& stop);

  DataDirectory& directory_;
  const ErrandOptions options_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<std::shared_ptr<Errand::State>> waiting_;  // guarded by mutex_
  bool stopping_ = false;                               // guarded by mutex_
  std::vector<std::jthread> threads_;                   // last: they use all of the above
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_ERRANDS_H_
