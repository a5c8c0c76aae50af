#include "server/jobs/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
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
#include <optional>
#include <sstream>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "server/jobs/fd.h"
#include "server/store/files.h"

namespace depthtween::server {
namespace {

constexpr size_t kMaxLineBytes = 64 << 10;
constexpr int64_t kErrorOutputBytes = 4 << 10;

// Of a clock that nobody sets, so that a correction of the time of day ends no child. Of no use as a date.
absl::Time MonotonicNow() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return absl::TimeFromTimespec(now);
}

// Nothing of ours: a variable may hold a secret, or change what a library does.
std::vector<std::string> ChildEnvironment() {
  std::vector<std::string> variables = {"LANG=C"};
#ifdef DEPTHTWEEN_SANITIZED
  for (const char* name : {"ASAN_OPTIONS", "LSAN_OPTIONS", "UBSAN_OPTIONS", "TSAN_OPTIONS", "LLVM_PROFILE_FILE"}) {
    if (const char* const value = getenv(name); value != nullptr) variables.push_back(absl::StrCat(name, "=", value));
  }
#endif
  return variables;
}

// Everything the child needs between fork and exec, made before: there it may only make system calls, because another
// thread may have held any lock, malloc's too.
class Launch {
 public:
  explicit Launch(const std::vector<std::string>& arguments) : environment_texts_(ChildEnvironment()) {
    for (const std::string& argument : arguments) arguments_.push_back(const_cast<char*>(argument.c_str()));
    arguments_.push_back(nullptr);
    for (std::string& variable : environment_texts_) environment_.push_back(variable.data());
    environment_.push_back(nullptr);
  }
  Launch(const Launch&) = delete;
  Launch& operator=(const Launch&) = delete;

  [[noreturn]] void Execute() const {
    execve(arguments_[0], arguments_.data(), environment_.data());
    const char* const reason = strerrordesc_np(errno);
    if (write(STDERR_FILENO, reason, strlen(reason)) < 0) _exit(126);
    _exit(127);
  }

 private:
  std::vector<std::string> environment_texts_;
  std::vector<char*> arguments_, environment_;
};

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

// A child that runs, as seen from here.
struct Child {
  pid_t id = 0;
  Fd process;   // readable once it has ended
  Fd progress;  // its lines; reading never waits
};

absl::StatusOr<Child> StartChild(const ChildSpec& spec) {
  std::array<int, 2> pipe_ends{};
  if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) return ErrnoStatus(errno, "pipe");
  Child child;
  child.progress = Fd(pipe_ends[0]);
  const Fd pipe_in(pipe_ends[1]);
  const auto open_output = [&spec](const char* name) {
    return Fd(open((spec.folder + name).c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  };
  const Fd output = open_output("/stdout");
  if (!output.valid()) return ErrnoStatus(errno, "create " + spec.folder + "/stdout");
  const Fd error_output = open_output("/stderr");
  if (!error_output.valid()) return ErrnoStatus(errno, "create " + spec.folder + "/stderr");
  // Only the reading end: the child expects writes to wait when the pipe is full.
  if (fcntl(child.progress.get(), F_SETFL, O_NONBLOCK) != 0) return ErrnoStatus(errno, "fcntl");

  const LaunchLimits limits{
      .memory_bytes = spec.memory_bytes, .file_bytes = spec.file_bytes, .cpu_seconds = spec.cpu_seconds};
  const LaunchFiles files{.progress = pipe_in.get(), .output = output.get(), .error_output = error_output.get()};
  std::optional<pid_t> hosted;
  if (spec.host != nullptr) {
    ASSIGN_OR_RETURN(hosted, spec.host->Launch(spec.arguments, limits, files));
  }
  ASSIGN_OR_RETURN(child.id, hosted ? *hosted : StartProgram(spec.arguments, limits, files));
  setpgid(child.id, child.id);  // parent and child both do: either may come first
  child.process = Fd(pidfd_open(child.id, 0));
  if (!child.process.valid()) {
    const int error_number = errno;
    kill(-child.id, SIGKILL);
    waitpid(child.id, nullptr, 0);
    return ErrnoStatus(error_number, "pidfd_open");
  }
  return child;  // the ends that are the child's close here
}

// Takes the child's lines until it has ended, and ends it when `stop_event` is readable, on_line says so or its time is
// over: first with SIGTERM, after the grace with SIGKILL.
class Supervision {
 public:
  Supervision(const ChildSpec& spec, const Child& child, const Fd& stop_event,
              const std::function<bool(std::string_view line)>& on_line, ChildOutcome& outcome)
      : spec_(spec), child_(child), stop_event_(stop_event), on_line_(on_line), outcome_(outcome) {}

  void Run() {
    while (Wait()) {
    }
  }

 private:
  // The next thing that happens. False once the child has ended.
  bool Wait() {
    // The end of the pipe is not the end of the child, nor the other way round.
    std::array<pollfd, 3> waits{{{child_.process.get(), POLLIN, 0},
                                 {outcome_.stopped ? -1 : stop_event_.get(), POLLIN, 0},
                                 {pipe_open_ ? child_.progress.get() : -1, POLLIN, 0}}};
    if (poll(waits.data(), waits.size(), TimeoutMs()) < 0 && errno != EINTR) return false;
    const bool running = waits[0].revents == 0;
    // What it has said is heard first: this thread may have been away for long, at work on an earlier line.
    if (waits[2].revents != 0 || !running) pipe_open_ = ReadLines() && pipe_open_;
    if (waits[1].revents != 0) BeginStop();
    const absl::Time now = MonotonicNow();
    if (running && !outcome_.stopped && now >= std::min(time_over_, stall_at_)) {
      (now >= time_over_ ? outcome_.timed_out : outcome_.stalled) = true;
      BeginStop();
    }
    if (now >= kill_at_) {
      kill(-child_.id, SIGKILL);
      kill_at_ = absl::InfiniteFuture();
    }
    return running;
  }

  int TimeoutMs() const {
    const absl::Time next = outcome_.stopped ? kill_at_ : std::min(time_over_, stall_at_);
    if (next == absl::InfiniteFuture()) return -1;
    const int64_t left_ms = absl::ToInt64Milliseconds(next - MonotonicNow()) + 1;
    return static_cast<int>(std::clamp<int64_t>(left_ms, 0, std::numeric_limits<int>::max()));
  }

  void BeginStop() {
    if (std::exchange(outcome_.stopped, true)) return;
    kill(-child_.id, SIGTERM);
    kill_at_ = MonotonicNow() + spec_.grace;
  }

  bool ReadLines() {
    bool said = false;
    const bool open = reader_.ReadFrom(child_.progress.get(), [&](std::string_view line) {
      said = true;
      if (!on_line_(line)) BeginStop();
    });
    if (said) stall_at_ = MonotonicNow() + spec_.stall_limit;
    return open;
  }

  const ChildSpec& spec_;
  const Child& child_;
  const Fd& stop_event_;
  const std::function<bool(std::string_view line)>& on_line_;
  ChildOutcome& outcome_;
  absl::Time kill_at_ = absl::InfiniteFuture();
  const absl::Time time_over_ = MonotonicNow() + spec_.time_limit;
  absl::Time stall_at_ = MonotonicNow() + spec_.stall_limit;
  LineReader reader_;
  bool pipe_open_ = true;
};

}  // namespace

absl::StatusOr<pid_t> StartProgram(const std::vector<std::string>& arguments, const LaunchLimits& limits,
                                   const LaunchFiles& files) {
  const Launch launch(arguments);
  // dup2 in the child must not hit a descriptor that it still needs.
  std::vector<Fd> moved;
  LaunchFiles above = files;
  for (int* const source : {&above.progress, &above.output, &above.error_output}) {
    moved.emplace_back(fcntl(*source, F_DUPFD_CLOEXEC, kProgressFd + 1));
    if (!moved.back().valid()) return ErrnoStatus(errno, "fcntl");
    *source = moved.back().get();
  }
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child < 0) return ErrnoStatus(errno, "fork");
  if (child == 0) {
    BecomeTask(above, limits, parent);
    launch.Execute();
  }
  return child;
}

std::string ChildOutcome::Describe() const {
  if (signal == 0) return absl::StrCat("exit code ", exit_code);
  const char* const name = sigabbrev_np(signal);
  const char* const meaning = sigdescr_np(signal);
  return absl::StrCat("killed by SIG", name == nullptr ? absl::StrCat(signal) : name, " (",
                      meaning == nullptr ? "unknown" : meaning, ")");
}

absl::StatusOr<ChildOutcome> RunChild(const ChildSpec& spec, const std::stop_token& stop,
                                      const std::function<bool(std::string_view line)>& on_line) {
  const Fd stop_event(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (!stop_event.valid()) return ErrnoStatus(errno, "eventfd");
  ASSIGN_OR_RETURN(const Child child, StartChild(spec));
  // For KillLeftChild. Without it there is still PR_SET_PDEATHSIG, so a full disk is no reason to stop here.
  WriteScratchFile(spec.folder + "/child", absl::StrCat(child.id, " ", StartTime(child.id), "\n")).IgnoreError();

  ChildOutcome outcome;
  {
    const std::stop_callback on_stop(stop, [&stop_event] {
      const uint64_t one = 1;
      // Cannot fail: the counter is far from full.
      [[maybe_unused]] const ssize_t written = write(stop_event.get(), &one, sizeof(one));
    });
    Supervision(spec, child, stop_event, on_line, outcome).Run();
  }

  // Before it is reaped its id cannot belong to anybody else: the moment to end whatever it has started itself.
  kill(-child.id, SIGKILL);
  int state = 0;
  while (waitpid(child.id, &state, 0) < 0 && errno == EINTR) {
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
