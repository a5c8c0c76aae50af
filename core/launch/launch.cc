#include "core/launch/launch.h"

#include <dirent.h>
#include <fcntl.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <utility>

namespace depthtween {
namespace {

// Between SIGXCPU and SIGKILL when the processor time is used up: nothing of ours catches the first.
constexpr int64_t kCpuGraceSeconds = 5;
constexpr size_t kMaxPacketBytes = 64 << 10;
constexpr size_t kFiles = 3;
// Forking takes a millisecond. One that takes this long is suspended, or the machine is out of breath.
constexpr timeval kHostPatience{.tv_sec = 10, .tv_usec = 0};

void Limit(__rlimit_resource resource, int64_t soft, int64_t hard) {
  const rlimit limit{static_cast<rlim_t>(soft), static_cast<rlim_t>(hard)};
  setrlimit(resource, &limit);
}

// Room for three descriptors beside a packet.
struct Rights {
  alignas(cmsghdr) std::array<char, CMSG_SPACE(kFiles * sizeof(int))> bytes{};
};

msghdr Message(iovec& data, Rights& rights) {
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = rights.bytes.data();
  message.msg_controllen = rights.bytes.size();
  return message;
}

struct Order {
  std::string packet;  // its arguments point into it
  LaunchLimits limits;
  std::vector<const char*> arguments;
  LaunchFiles files;
};

// False when the other end is closed, or sends what is no order.
bool ReceiveOrder(int socket, Order& order) {
  order.packet.resize(kMaxPacketBytes);
  iovec data{.iov_base = order.packet.data(), .iov_len = order.packet.size()};
  Rights rights;
  msghdr message = Message(data, rights);
  ssize_t got = 0;
  do {
    got = recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
  } while (got < 0 && errno == EINTR);
  const cmsghdr* const control = CMSG_FIRSTHDR(&message);
  if (got <= static_cast<ssize_t>(sizeof(LaunchLimits)) || control == nullptr || control->cmsg_type != SCM_RIGHTS ||
      control->cmsg_len != CMSG_LEN(kFiles * sizeof(int))) {
    return false;
  }
  std::array<int, kFiles> files{};
  std::memcpy(files.data(), CMSG_DATA(control), sizeof(files));
  order.files = {.progress = files[0], .output = files[1], .error_output = files[2]};
  order.packet.resize(static_cast<size_t>(got));
  std::memcpy(&order.limits, order.packet.data(), sizeof(order.limits));
  order.arguments.clear();
  for (size_t begin = sizeof(order.limits); begin < order.packet.size();) {
    order.arguments.push_back(order.packet.data() + begin);
    begin = order.packet.find('\0', begin);
    if (begin == std::string::npos) return false;
    ++begin;
  }
  return true;
}

// Fork copies the calling thread alone: a lock that another one holds would stay locked for ever. Ours starts none, but
// a library may.
bool IsAlone() {
  DIR* const threads = opendir("/proc/self/task");
  if (threads == nullptr) return false;
  int count = 0;
  while (const dirent* entry = readdir(threads)) count += entry->d_name[0] != '.' ? 1 : 0;
  closedir(threads);
  return count == 1;
}

// A child of our parent. Not fork(), which cannot do that; what fork() does beside is for processes with threads.
pid_t ForkSibling() { return static_cast<pid_t>(syscall(SYS_clone, CLONE_PARENT | SIGCHLD, 0, 0, 0, 0)); }

// "task-intervals" of "depthtween-core task intervals ...": what process lists show, which know the host's command line
// alone. The system cuts it after 15 characters.
void NameTask(const std::vector<const char*>& arguments) {
  std::string name = "task";
  if (arguments.size() > 2) name.append("-").append(arguments[2]);
  prctl(PR_SET_NAME, name.c_str());
}

void Answer(int socket, int32_t answer) {
  // If nobody takes it, the next order does not come either.
  [[maybe_unused]] const ssize_t sent = send(socket, &answer, sizeof(answer), MSG_NOSIGNAL);
}

}  // namespace

void BecomeTask(const LaunchFiles& files, const LaunchLimits& limits, pid_t parent) {
  setpgid(0, 0);
  // The server's death is the task's. If it died before this line, nobody is there to send the signal any more.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(127);

  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  for (const int number : {SIGPIPE, SIGTERM, SIGINT, SIGHUP, SIGCHLD}) signal(number, SIG_DFL);

  const int nothing = open("/dev/null", O_RDONLY);
  if (dup2(nothing, STDIN_FILENO) < 0 || dup2(files.output, STDOUT_FILENO) < 0 ||
      dup2(files.error_output, STDERR_FILENO) < 0 || dup2(files.progress, kProgressFd) < 0) {
    _exit(127);
  }
  // Sockets and the data directory's lock stay with the server.
  syscall(SYS_close_range, kProgressFd + 1, ~0U, 0);

  Limit(RLIMIT_CORE, 0, 0);
  if (limits.memory_bytes > 0) Limit(RLIMIT_DATA, limits.memory_bytes, limits.memory_bytes);
  if (limits.cpu_seconds > 0) Limit(RLIMIT_CPU, limits.cpu_seconds, limits.cpu_seconds + kCpuGraceSeconds);
  if (limits.file_bytes > 0) {
    Limit(RLIMIT_FSIZE, limits.file_bytes, limits.file_bytes);
    signal(SIGXFSZ, SIG_IGN);  // so that a write beyond fails with EFBIG, which the task can report
  }
  // When memory runs out, a task is to go before the server.
  if (const int fd = open("/proc/self/oom_score_adj", O_WRONLY); fd >= 0) {
    if (write(fd, "500", 3) < 0) _exit(127);
    close(fd);
  }

  // What the task starts, should it ever, gains nothing by it.
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
}

pid_t OrderTask(int socket, const std::vector<std::string>& arguments, const LaunchLimits& limits,
                const LaunchFiles& files) {
  std::string packet(sizeof(limits), '\0');
  std::memcpy(packet.data(), &limits, sizeof(limits));
  for (const std::string& argument : arguments) packet.append(argument.c_str(), argument.size() + 1);
  if (packet.size() > kMaxPacketBytes) return -EMSGSIZE;
  iovec data{.iov_base = packet.data(), .iov_len = packet.size()};
  Rights rights;
  msghdr message = Message(data, rights);
  cmsghdr* const control = CMSG_FIRSTHDR(&message);
  control->cmsg_level = SOL_SOCKET;
  control->cmsg_type = SCM_RIGHTS;
  control->cmsg_len = CMSG_LEN(kFiles * sizeof(int));
  const std::array<int, kFiles> sent{files.progress, files.output, files.error_output};
  std::memcpy(CMSG_DATA(control), sent.data(), sizeof(sent));
  if (sendmsg(socket, &message, MSG_NOSIGNAL | MSG_DONTWAIT) < 0) return -EPIPE;
  int32_t answer = 0;
  ssize_t got = 0;
  setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &kHostPatience, sizeof(kHostPatience));
  do {
    got = recv(socket, &answer, sizeof(answer), 0);
  } while (got < 0 && errno == EINTR);
  return got == sizeof(answer) && answer != 0 ? answer : -ETIMEDOUT;
}

bool HostIsReady(int socket) {
  setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &kHostPatience, sizeof(kHostPatience));
  int32_t hello = -1;
  return recv(socket, &hello, sizeof(hello), 0) == sizeof(hello) && hello == 0;
}

void HostTasks(int socket, int (*run)(int argc, const char* const* argv)) {
  prctl(PR_SET_NAME, kHostCommand);
  const pid_t parent = getppid();
  Answer(socket, 0);
  Order order;
  while (ReceiveOrder(socket, order)) {
    const pid_t child = IsAlone() ? ForkSibling() : -1;
    if (child == 0) {
      NameTask(order.arguments);
      BecomeTask(order.files, order.limits, parent);
      order.arguments.push_back(nullptr);
      std::exit(run(static_cast<int>(order.arguments.size()) - 1, order.arguments.data()));
    }
    Answer(socket, child > 0 ? child : -EBUSY);
    for (const int file : {order.files.progress, order.files.output, order.files.error_output}) close(file);
  }
}

}  // namespace depthtween
