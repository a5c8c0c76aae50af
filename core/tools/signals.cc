#include "core/tools/signals.h"

#include <pthread.h>
#include <signal.h>

namespace depthtween::tools {
namespace {

sigset_t StopSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  return signals;
}

}  // namespace

// A thread waits for the signals instead of a handler: request_stop() runs callbacks and may not be called in a
// handler.
StopOnSignals::StopOnSignals() {
  const sigset_t signals = StopSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  watcher_ = std::thread([this] { Watch(); });
}

StopOnSignals::~StopOnSignals() {
  closing_ = true;
  pthread_kill(watcher_.native_handle(), SIGTERM);  // wakes it: directed at the thread, seen by nobody else
  watcher_.join();
  const sigset_t signals = StopSignals();
  pthread_sigmask(SIG_UNBLOCK, &signals, nullptr);
}

void StopOnSignals::Watch() {
  const sigset_t signals = StopSignals();
  while (true) {
    int signal = 0;
    sigwait(&signals, &signal);
    if (closing_) return;
    if (!stop_.request_stop()) {  // the second signal: end at once
      ::signal(signal, SIG_DFL);
      pthread_sigmask(SIG_UNBLOCK, &signals, nullptr);
      raise(signal);
    }
  }
}

}  // namespace depthtween::tools
