// Keeps a host of depthtween-core (core/launch/launch.h) alive, which forks tasks faster than the program starts.
#ifndef DEPTHTWEEN_SERVER_JOBS_TASK_HOST_H_
#define DEPTHTWEEN_SERVER_JOBS_TASK_HOST_H_

#include <sys/types.h>

#include <atomic>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "core/launch/launch.h"

namespace depthtween::server {

// Threads: Launch may be called concurrently.
class TaskHost {
 public:
  // Starts a host, which is ready a moment later, and another when one dies: the second after the pause, later ones
  // after ever longer ones. Every task that it launched dies with this object, so those that launch end before. The
  // first host is forked when this returns. Until a forked process has closed its copies of our descriptors, a
  // connection that we close stays in the epoll sets of gRPC and Asio, which do not expect that: so a server makes this
  // before it listens.
  explicit TaskHost(std::string core_program, absl::Duration pause = absl::Seconds(1));
  ~TaskHost();
  TaskHost(const TaskHost&) = delete;
  TaskHost& operator=(const TaskHost&) = delete;

  // The process id of a new child of this process, which runs `depthtween-core arguments`. nullopt when there is no
  // host (yet): start the program instead. DeadlineExceeded when it does not answer: the task may live, so that another
  // one must not work in the same folder.
  absl::StatusOr<std::optional<pid_t>> Launch(const std::vector<std::string>& arguments, const LaunchLimits& limits,
                                              const LaunchFiles& files);

 private:
  // Of the thread that is the parent of the host, and so of all tasks.
  void Keep(const std::stop_token& stop);
  void Forked();
  // From the start of a host to its end.
  void HostOnce(const std::stop_token& stop);

  const std::string core_program_;
  const absl::Duration pause_;
  std::mutex mutex_;
  int socket_ = -1;  // guarded by mutex_; -1: no host is ready
  std::atomic<bool> forked_ = false;
  std::jthread keeper_;  // last: it uses all of the above
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_TASK_HOST_H_
