#include "server/jobs/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

extern "C" {  // which the header of glibc 2.36 leaves out
#include <sys/pidfd.h>
}

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "server/jobs/files.h"

namespace depthtween::server {
namespace {

constexpr int kProgressFd = 3;
constexpr size_t kMaxLineBytes = 64 << 10;
constexpr int64_t kErrorOutputBytes = 4 << 10;

class Fd {
 public:
  explicit Fd(int fd = -1) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Fd() { Close(); }
  void Close() {
    if (fd_ >= 0) close(std::exchange(fd_, -1));
  }
  int get() const { return fd_; }
  bool valid() const { return fd_ >= 0; }

 private:
  int fd_;
};

// Everything the child needs between fork and exec, made before: there it may only make system calls, because another
// thread may have held any lock, malloc's too.
struct Launch {
  std::vector<char*> arguments;
  int progress, output, error_output;
  pid_t parent;
  int64_t memory_bytes, file_bytes;
};

void Limit(__rlimit_resource resource, int64_t bytes) {
  const auto value = static_cast<rlim_t>(bytes);
  const rlimit limit{value, value};
  setrlimit(resource, &limit);
}

[[noreturn]] void BecomeChild(const Launch& launch) {
  setpgid(0, 0);
  // The server's death is the child's. If it died before this line, nobody is there to send the signal any more.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != launch.parent) _exit(127);

  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  for (const int number : {SIGPIPE, SIGTERM, SIGINT, SIGHUP, SIGCHLD}) signal(number, SIG_DFL);

  const int nothing = open("/dev/null", O_RDONLY);
  if (dup2(nothing, STDIN_FILENO) < 0 || dup2(launch.output, STDOUT_FILENO) < 0 ||
      dup2(launch.error_output, STDERR_FILENO) < 0 || dup2(launch.progress, kProgressFd) < 0) {
    _exit(127);
  }
  // Sockets and the data directory's lock stay with the server.
  syscall(SYS_close_range, kProgressFd + 1, ~0U, 0);

  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  if (launch.memory_bytes > 0) Limit(RLIMIT_DATA, launch.memory_bytes);
  if (launch.file_bytes > 0) {
    Limit(RLIMIT_FSIZE, launch.file_bytes);
    signal(SIGXFSZ, SIG_IGN);  // so that a write beyond fails with EFBIG, which the child can report
  }
  // When memory runs out, a child is to go before the server.
  if (const int fd = open("/proc/self/oom_score_adj", O_WRONLY); fd >= 0) {
    if (write(fd, "500", 3) < 0) _exit(127);
    close(fd);
  }

  execv(launch.arguments[0], launch.arguments.data());
  const char* const reason = strerrordesc_np(errno);
  if (write(STDERR_FILENO, reason, strlen(reason)) < 0) _exit(126);
  _exit(127);
}

// Field 22 of /proc/<pid>/stat, in clock ticks since boot: with the id, it names a process for good. Empty if it is
// gone or a zombie.
std::string StartTime(pid_t pid) {
  std::ifstream file(absl::StrCat("/proc/", pid, "/stat"));
  std::stringstream content;
  content << file.rdbuf();
  const std::string text = content.str();
  // The second field is the name in parentheses, which may hold blanks.
  const size_t name_end = text.rfind(") ");
  if (name_end == std::string::npos) return {};
  const std::vector<std::string> fields = absl::StrSplit(text.substr(name_end + 2), ' ');
  return fields.size() > 19 && fields[0] != "Z" ? fields[19] : std::string();
}

// Cuts what comes down the pipe into lines.
class LineReader {
 public:
  // Reads what is there, but no more than a pipe can hold: a child that never stops talking must not keep us here.
  // False at the end of the pipe.
  bool ReadFrom(int fd, const std::function<void(std::string_view)>& on_line) {
    std::array<char, 16 << 10> piece;
    for (int i = 0; i < 64; ++i) {
      const ssize_t got = read(fd, piece.data(), piece.size());
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return errno == EAGAIN;
      if (got == 0) return false;
      for (const char c : std::string_view(piece.data(), static_cast<size_t>(got))) {
        if (c == '\n') {
          on_line(line_);
          line_.clear();
        } else if (line_.size() < kMaxLineBytes) {
          line_.push_back(c);
        }
      }
    }
    return true;
  }

 private:
  std::string line_;
};

std::string EndOfFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const int64_t size = file.tellg();
  if (!file || size <= 0) return {};
  const int64_t wanted = std::min(size, kErrorOutputBytes);
  std::string text(static_cast<size_t>(wanted), '\0');
  file.seekg(size - wanted);
  file.read(text.data(), wanted);
  return text;
}

}  // namespace

std::string ChildOutcome::Describe() const {
  if (signal == 0) return absl::StrCat("exit code ", exit_code);
  const char* const name = sigabbrev_np(signal);
  const char* const meaning = sigdescr_np(signal);
  return absl::StrCat("killed by SIG", name == nullptr ? absl::StrCat(signal) : name, " (",
                      meaning == nullptr ? "unknown" : meaning, ")");
}

absl::StatusOr<ChildOutcome> RunChild(const ChildSpec& spec, std::stop_token stop,
                                      const std::function<bool(std::string_view line)>& on_line) {
  std::array<int, 2> pipe_ends{};
  if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) return ErrnoStatus(errno, "pipe");
  const Fd pipe_out(pipe_ends[0]);
  Fd pipe_in(pipe_ends[1]);
  const auto open_output = [&spec](const char* name) {
    return Fd(open((spec.folder + name).c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  };
  Fd output = open_output("/stdout");
  if (!output.valid()) return ErrnoStatus(errno, "create " + spec.folder + "/stdout");
  Fd error_output = open_output("/stderr");
  if (!error_output.valid()) return ErrnoStatus(errno, "create " + spec.folder + "/stderr");
  const Fd stop_event(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (!stop_event.valid()) return ErrnoStatus(errno, "eventfd");
  // Only the reading end: the child expects writes to wait when the pipe is full.
  if (fcntl(pipe_out.get(), F_SETFL, O_NONBLOCK) != 0) return ErrnoStatus(errno, "fcntl");

  Launch launch{.progress = pipe_in.get(),
                .output = output.get(),
                .error_output = error_output.get(),
                .parent = getpid(),
                .memory_bytes = spec.memory_bytes,
                .file_bytes = spec.file_bytes};
  for (const std::string& argument : spec.arguments) launch.arguments.push_back(const_cast<char*>(argument.c_str()));
  launch.arguments.push_back(nullptr);
  // dup2 in the child must not hit a descriptor that it still needs.
  std::array<Fd, 3> moved;
  int* const sources[] = {&launch.progress, &launch.output, &launch.error_output};
  for (size_t i = 0; i < moved.size(); ++i) {
    moved[i] = Fd(fcntl(*sources[i], F_DUPFD_CLOEXEC, kProgressFd + 1));
    if (!moved[i].valid()) return ErrnoStatus(errno, "fcntl");
    *sources[i] = moved[i].get();
  }

  const pid_t child = fork();
  if (child < 0) return ErrnoStatus(errno, "fork");
  if (child == 0) BecomeChild(launch);
  setpgid(child, child);  // whoever of the two comes first
  for (Fd& fd : moved) fd.Close();
  for (Fd* fd : {&pipe_in, &output, &error_output}) fd->Close();
  const Fd process(pidfd_open(child, 0));
  if (!process.valid()) {
    const int error_number = errno;
    kill(-child, SIGKILL);
    waitpid(child, nullptr, 0);
    return ErrnoStatus(error_number, "pidfd_open");
  }
  // For KillLeftChild. Without it there is still PR_SET_PDEATHSIG, so a full disk is no reason to stop here.
  WriteScratchFile(spec.folder + "/child", absl::StrCat(child, " ", StartTime(child), "\n")).IgnoreError();

  ChildOutcome outcome;
  const std::stop_callback on_stop(stop, [&stop_event] {
    const uint64_t one = 1;
    // Cannot fail: the counter is far from full.
    [[maybe_unused]] const ssize_t written = write(stop_event.get(), &one, sizeof(one));
  });
  absl::Time kill_at = absl::InfiniteFuture();
  const absl::Time time_over = absl::Now() + spec.time_limit;
  const auto begin_stop = [&] {
    if (std::exchange(outcome.stopped, true)) return;
    kill(-child, SIGTERM);
    kill_at = absl::Now() + spec.grace;
  };
  LineReader reader;
  const auto take_line = [&](std::string_view line) {
    if (!on_line(line)) begin_stop();
  };
  bool pipe_open = true;
  for (bool running = true; running;) {
    // The end of the pipe is not the end of the child, nor the other way round.
    std::array<pollfd, 3> waits{{{process.get(), POLLIN, 0},
                                 {outcome.stopped ? -1 : stop_event.get(), POLLIN, 0},
                                 {pipe_open ? pipe_out.get() : -1, POLLIN, 0}}};
    int timeout_ms = -1;
    if (const absl::Time next = outcome.stopped ? kill_at : time_over; next != absl::InfiniteFuture()) {
      const int64_t left_ms = absl::ToInt64Milliseconds(next - absl::Now()) + 1;
      timeout_ms = static_cast<int>(std::clamp<int64_t>(left_ms, 0, std::numeric_limits<int>::max()));
    }
    if (poll(waits.data(), waits.size(), timeout_ms) < 0 && errno != EINTR) break;
    if (!outcome.stopped && absl::Now() >= time_over) {
      outcome.timed_out = true;
      begin_stop();
    }
    if (absl::Now() >= kill_at) {
      kill(-child, SIGKILL);
      kill_at = absl::InfiniteFuture();
    }
    if (waits[1].revents != 0) begin_stop();
    running = waits[0].revents == 0;
    if (waits[2].revents != 0 || !running) pipe_open = reader.ReadFrom(pipe_out.get(), take_line) && pipe_open;
  }

  // Before it is reaped its id cannot belong to anybody else: the moment to end whatever it has started itself.
  kill(-child, SIGKILL);
  int state = 0;
  while (waitpid(child, &state, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(state)) outcome.exit_code = WEXITSTATUS(state);
  if (WIFSIGNALED(state)) outcome.signal = WTERMSIG(state);
  outcome.error_output = EndOfFile(spec.folder + "/stderr");
  return outcome;
}

void KillLeftChild(const std::string& folder) {
  const absl::StatusOr<std::string> text = ReadWholeFile(folder + "/child", /*max_bytes=*/256);
  if (!text.ok()) return;
  const std::vector<std::string> words = absl::StrSplit(*text, absl::ByAnyChar(" \n"), absl::SkipEmpty());
  pid_t child = 0;
  if (words.size() != 2 || !absl::SimpleAtoi(words[0], &child) || child <= 1) return;
  // It is not our child, so nothing tells when it has gone: a killed process goes within milliseconds.
  for (int i = 0; i < 500 && StartTime(child) == words[1]; ++i) {
    kill(-child, SIGKILL);
    absl::SleepFor(absl::Milliseconds(10));
  }
}

}  // namespace depthtween::server
