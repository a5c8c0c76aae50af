// A host that this test forks, whose tasks do what their first argument says; what they were given is asked of the
// kernel.
#include "core/launch/launch.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

namespace depthtween {
namespace {

void Say(const std::string& text) {
  if (write(kProgressFd, text.data(), text.size()) < 0) _exit(99);
}

int RunTestTask(int argc, const char* const* argv) {
  const std::string word = argc > 1 ? argv[1] : "";
  if (word == "exit") return std::stoi(argv[2]);
  if (word == "wait") {
    Say("waiting");
    while (true) pause();
  }
  rlimit memory{}, file{};
  getrlimit(RLIMIT_DATA, &memory);
  getrlimit(RLIMIT_FSIZE, &file);
  Say("parent " + std::to_string(getppid()) + ", group " + std::to_string(getpgid(0) == getpid() ? 1 : 0) +
      ", memory " + std::to_string(memory.rlim_cur) + ", file " + std::to_string(file.rlim_cur) + ", arguments " +
      std::to_string(argc) + " " + argv[argc - 1]);
  return 0;
}

class LaunchTest : public testing::Test {
 protected:
  LaunchTest() {
    std::array<int, 2> ends{};
    EXPECT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()), 0);
    socket_ = ends[0];
    EXPECT_EQ(pipe2(pipe_.data(), O_CLOEXEC), 0);
    host_ = fork();
    if (host_ == 0) {
      close(socket_);  // else it would be its own other end
      HostTasks(ends[1], RunTestTask);
      _exit(0);
    }
    close(ends[1]);
  }
  ~LaunchTest() override {
    close(socket_);
    EXPECT_EQ(waitpid(host_, nullptr, 0), host_);
    for (const int end : pipe_) close(end);
  }

  pid_t Order(const std::vector<std::string>& arguments, const LaunchLimits& limits = {}) {
    return OrderTask(socket_, arguments, limits, {.progress = pipe_[1], .output = 1, .error_output = 2});
  }
  static int StatusOf(pid_t task) {
    int status = -1;
    EXPECT_EQ(waitpid(task, &status, 0), task) << strerror(errno);
    return status;
  }

  int socket_ = -1;
  pid_t host_ = -1;
  std::array<int, 2> pipe_{};
};

TEST_F(LaunchTest, ATaskIsAChildOfWhoOrdersIt) {
  ASSERT_TRUE(HostIsReady(socket_));
  const pid_t task = Order({"program", "tell", "a b"}, {.memory_bytes = 1 << 30, .file_bytes = 1 << 20});
  ASSERT_GT(task, 0);
  EXPECT_EQ(StatusOf(task), 0);
  std::array<char, 1000> text{};
  ASSERT_GT(read(pipe_[0], text.data(), text.size() - 1), 0);
  EXPECT_EQ(std::string(text.data()),
            "parent " + std::to_string(getpid()) + ", group 1, memory 1073741824, file 1048576, arguments 3 a b");
}

TEST_F(LaunchTest, ManyTasksEachWithItsEnd) {
  ASSERT_TRUE(HostIsReady(socket_));
  for (int code = 0; code < 50; ++code) {
    const pid_t task = Order({"program", "exit", std::to_string(code)});
    ASSERT_GT(task, 0);
    EXPECT_EQ(WEXITSTATUS(StatusOf(task)), code);
  }
  const pid_t task = Order({"program", "wait"});
  ASSERT_GT(task, 0);
  kill(task, SIGTERM);
  EXPECT_EQ(WTERMSIG(StatusOf(task)), SIGTERM);
}

TEST_F(LaunchTest, ATaskOutlivesTheHost) {
  ASSERT_TRUE(HostIsReady(socket_));
  const pid_t task = Order({"program", "wait"});
  ASSERT_GT(task, 0);
  // Until it has begun it holds the host's end of the socket too, and orders would go to nobody.
  std::array<char, 10> text{};
  ASSERT_GT(read(pipe_[0], text.data(), text.size()), 0);
  kill(host_, SIGKILL);
  siginfo_t ended{};
  ASSERT_EQ(waitid(P_PID, static_cast<id_t>(host_), &ended, WEXITED | WNOWAIT), 0);
  EXPECT_EQ(Order({"program", "exit", "0"}), -EPIPE);
  EXPECT_EQ(kill(task, SIGKILL), 0);
  EXPECT_EQ(WTERMSIG(StatusOf(task)), SIGKILL);
}

TEST_F(LaunchTest, RefusesWhatIsTooLong) {
  ASSERT_TRUE(HostIsReady(socket_));
  EXPECT_EQ(Order({"program", std::string(70'000, 'x')}), -EMSGSIZE);
  EXPECT_EQ(WEXITSTATUS(StatusOf(Order({"program", "exit", "5"}))), 5);
}

}  // namespace
}  // namespace depthtween
