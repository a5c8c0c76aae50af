#include "server/jobs/task_host.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

extern "C" {  // which the header of glibc 2.36 leaves out
#include <sys/pidfd.h>
}

#include <algorithm>
#include <array>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "server/jobs/child_process.h"
#include "server/jobs/fd.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

constexpr absl::Duration kLongestPause = absl::Minutes(10);

}  // namespace

TaskHost::TaskHost(std::string core_program, absl::Duration pause)
    : core_program_(std::move(core_program)),
      pause_(pause),
      keeper_([this](const std::stop_token& stop) { Keep(stop); }) {
  forked_.wait(false);
}

TaskHost::~TaskHost() {
  keeper_.request_stop();
  keeper_.join();
}

absl::StatusOr<std::optional<pid_t>> TaskHost::Launch(const std::vector<std::string>& arguments,
                                                      const LaunchLimits& limits, const LaunchFiles& files) {
  const std::lock_guard lock(mutex_);
  if (socket_ < 0) return std::nullopt;
  const pid_t answer = OrderTask(socket_, arguments, limits, files);
  if (answer > 0) return answer;
  if (answer == -EMSGSIZE) return std::nullopt;
  // Whoever keeps it sees the end of the connection, and ends it.
  shutdown(socket_, SHUT_RDWR);
  socket_ = -1;
  if (answer == -ETIMEDOUT) return absl::DeadlineExceededError("the process that starts tasks did not answer");
  return std::nullopt;
}

void TaskHost::Keep(const std::stop_token& stop) {
  absl::Duration pause = pause_;
  std::mutex waiting;
  std::condition_variable_any changed;
  while (!stop.stop_requested()) {
    HostOnce(stop);
    std::unique_lock lock(waiting);
    changed.wait_for(lock, stop, absl::ToChronoNanoseconds(pause), [] { return false; });
    pause = std::min(2 * pause, kLongestPause);
  }
}

void TaskHost::Forked() {
  forked_ = true;
  forked_.notify_all();
}

void TaskHost::HostOnce(const std::stop_token& stop) {
  const absl::Cleanup forked = [this] { Forked(); };  // or there is nothing to be forked
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0) return;
  const Fd ours(ends[0]);
  Fd its(ends[1]);
  const Fd nothing(open("/dev/null", O_WRONLY | O_CLOEXEC));
  const absl::StatusOr<pid_t> host =
      StartProgram({core_program_, kHostCommand}, {},
                   {.progress = its.get(), .output = nothing.get(), .error_output = nothing.get()});
  Forked();
  its.Close();
  if (!host.ok()) return;
  // Ends its waiting, for what it is and for being closed.
  const std::stop_callback on_stop(stop, [&] { shutdown(ours.get(), SHUT_RDWR); });
  const Fd process(pidfd_open(*host, 0));
  if (process.valid() && HostIsReady(ours.get())) {
    {
      const std::lock_guard lock(mutex_);
      if (!stop.stop_requested()) socket_ = ours.get();
    }
    // Readable: it has ended. What comes over the connection is for Launch, so only its end is of interest here.
    std::array<pollfd, 2> waits{{{process.get(), POLLIN, 0}, {ours.get(), POLLRDHUP, 0}}};
    while (poll(waits.data(), waits.size(), -1) < 0 && errno == EINTR) {
    }
    if (!stop.stop_requested()) LogWarning("the process that starts tasks has ended; there will be another", {});
  }
  {
    const std::lock_guard lock(mutex_);
    socket_ = -1;
  }
  kill(*host, SIGKILL);
  while (waitpid(*host, nullptr, 0) < 0 && errno == EINTR) {
  }
}

}  // namespace depthtween::server
