// How a task comes to life: what a process that was just forked does before it is one, and the host, a process that has
// loaded every library once and forks a task for each order, which saves each task the 70 ms of loading them.
//
// The host stands between the server and its tasks only at their birth: a task is the server's child, not the host's
// (CLONE_PARENT), so that the server waits for it, signals it, and takes it along when it dies. The host never opens a
// stranger's file; a task shuts itself in after it was forked (core/sandbox).
//
// On the wire: the server sends one packet for each order, with the three files of the task; the host answers with one.
// The first packet of all is the host's: it is ready.
//
// Errors are errno values: some of this runs between fork and exec, where nothing but system calls is allowed.
#ifndef DEPTHTWEEN_CORE_LAUNCH_LAUNCH_H_
#define DEPTHTWEEN_CORE_LAUNCH_LAUNCH_H_

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

namespace depthtween {

// Where a task finds the pipe for its progress, and a host its socket.
inline constexpr int kProgressFd = 3;
// The command of depthtween-core that hosts.
inline constexpr char kHostCommand[] = "task-host";

struct LaunchLimits {
  int64_t memory_bytes = 0;  // RLIMIT_DATA; 0 = none
  int64_t file_bytes = 0;    // RLIMIT_FSIZE; 0 = none
  int64_t cpu_seconds = 0;   // RLIMIT_CPU, over all threads; 0 = none
};

// Open files of the one who launches, all above kProgressFd.
struct LaunchFiles {
  int progress = -1, output = -1, error_output = -1;
};

// In a process that was just forked: a process group of its own, the files where it expects them and no others, limits,
// no new privileges; it dies with the thread of `parent` that is its parent. Makes system calls alone. Exits with 127
// if that fails, or if `parent` has died meanwhile.
void BecomeTask(const LaunchFiles& files, const LaunchLimits& limits, pid_t parent);

// Of the server: orders a task and returns its process id; negative: the errno of why there is none.
//   -EPIPE      the host is gone and has begun nothing
//   -EBUSY      the host has several threads, so it must not fork
//   -EMSGSIZE   the arguments are too long for it
//   -ETIMEDOUT  no answer in time, or the host died over it: a task may live that nobody knows
// Threads: one order at a time on one socket.
pid_t OrderTask(int socket, const std::vector<std::string>& arguments, const LaunchLimits& limits,
                const LaunchFiles& files);
// Of the server: waits for the first packet of a host. False if none came in time.
bool HostIsReady(int socket);

// Of the host: says that it is ready, and forks until the other end of `socket` is closed. `run` is the task: it gets
// what main() would, in the new process, which ends with what it returns. Returns in the host alone.
void HostTasks(int socket, int (*run)(int argc, const char* const* argv));

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_LAUNCH_LAUNCH_H_
