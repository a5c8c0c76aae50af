// The threads on which calls do their work: whatever may wait for a disk or a lock runs here and never on gRPC's own
// threads, which have to keep every connection moving.
#ifndef DEPTHTWEEN_SERVER_RPC_EXECUTOR_H_
#define DEPTHTWEEN_SERVER_RPC_EXECUTOR_H_

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace depthtween::server {

class Executor {
 public:
  explicit Executor(int threads);
  // Runs what was posted, then ends.
  ~Executor();
  Executor(const Executor&) = delete;
  Executor& operator=(const Executor&) = delete;

  // Runs `work` soon, in order of posting, on any of the threads. The queue needs no bound of its own: every call has
  // at most one entry in it, and CallRuntime bounds the calls.
  void Post(std::function<void()> work);

 private:
  void Run();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> queue_;  // guarded by mutex_
  bool closing_ = false;                     // guarded by mutex_
  std::vector<std::jthread> threads_;        // last: they use all of the above
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_EXECUTOR_H_
