// Turns SIGINT and SIGTERM into a stop token.
#ifndef DEPTHTWEEN_CORE_TOOLS_SIGNALS_H_
#define DEPTHTWEEN_CORE_TOOLS_SIGNALS_H_

#include <atomic>
#include <stop_token>
#include <thread>

namespace depthtween::tools {

// While it lives, the first SIGINT or SIGTERM fires token(); a second one ends the process at once.
// Make it before any other thread starts: threads inherit the blocked signals. One at a time per process.
class StopOnSignals {
 public:
  StopOnSignals();
  ~StopOnSignals();
  StopOnSignals(const StopOnSignals&) = delete;
  StopOnSignals& operator=(const StopOnSignals&) = delete;

  std::stop_token token() const { return stop_.get_token(); }
  // For another reason than a signal.
  void RequestStop() { stop_.request_stop(); }

 private:
  void Watch();

  std::stop_source stop_;
  std::atomic<bool> closing_ = false;
  std::thread watcher_;
};

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_SIGNALS_H_
