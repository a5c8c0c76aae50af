// A child process shuts itself in and then tries what a file that has taken it over would try. What must fail is tried
// outside of the sandbox too, where it works: so it is the sandbox that refuses.
#include "core/sandbox/sandbox.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <thread>

#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

class SandboxTest : public testing::Test {
 protected:
  SandboxTest() {
    for (const char* folder : {"in", "out", "other"}) mkdir((scratch_ / folder).c_str(), 0755);
    for (const char* file : {"in/frame", "other/database", "options"}) std::ofstream(scratch_ / file) << "bytes";
  }
  // The exit code of a child that does this, inside or outside.
  int Try(const std::function<int()>& deed, bool inside) {
    const pid_t child = fork();
    if (child == 0) {
      if (inside && !EnterSandbox({.read = {scratch_ / "in", scratch_ / "options", scratch_ / "absent"},
                                   .write = {scratch_ / "out"}})
                         .ok()) {
        _exit(100);
      }
      _exit(deed());
    }
    int state = 0;
    EXPECT_EQ(waitpid(child, &state, 0), child);
    return WIFEXITED(state) ? WEXITSTATUS(state) : 200;
  }
  // `deed` returns the error number of what it tries, or 0.
  void ExpectRefused(const std::function<int()>& deed, int error) {
    EXPECT_EQ(Try(deed, /*inside=*/false), 0) << "outside it works";
    EXPECT_EQ(Try(deed, /*inside=*/true), error);
  }
  void ExpectAllowed(const std::function<int()>& deed) { EXPECT_EQ(Try(deed, /*inside=*/true), 0); }
  static int Open(const std::string& path, int flags) { return open(path.c_str(), flags, 0644) < 0 ? errno : 0; }

  TemporaryFolder scratch_;
};

#define SKIP_WITHOUT(part)                                                      \
  if (!SupportedSandbox().part) GTEST_SKIP() << "this kernel lacks it: " #part; \
  static_assert(true)

TEST_F(SandboxTest, NoSockets) {
  SKIP_WITHOUT(system_calls);
  for (const int family : {AF_INET, AF_INET6, AF_UNIX}) {
    ExpectRefused([family] { return socket(family, SOCK_STREAM, 0) < 0 ? errno : 0; }, EPERM);
  }
  ExpectRefused(
      [] {
        int ends[2];
        return socketpair(AF_UNIX, SOCK_STREAM, 0, ends) < 0 ? errno : 0;
      },
      EPERM);
  // A socket that was open before cannot be connected either.
  sockaddr_in nobody{.sin_family = AF_INET, .sin_port = htons(9), .sin_addr = {htonl(INADDR_LOOPBACK)}};
  const int open_before = socket(AF_INET, SOCK_DGRAM, 0);
  ExpectRefused(
      [&] { return connect(open_before, reinterpret_cast<sockaddr*>(&nobody), sizeof(nobody)) < 0 ? errno : 0; },
      EPERM);
  close(open_before);
}

TEST_F(SandboxTest, NoProgramsAndNoProcesses) {
  SKIP_WITHOUT(system_calls);
  ExpectRefused(
      [] {
        execl("/bin/true", "true", nullptr);
        return errno;
      },
      EPERM);
  ExpectRefused(
      [] {
        const pid_t child = fork();
        if (child == 0) _exit(0);
        return child < 0 ? errno : 0;
      },
      EPERM);
}

TEST_F(SandboxTest, NoOtherProcess) {
  SKIP_WITHOUT(system_calls);
  const pid_t other = fork();
  if (other == 0) {
    while (true) pause();
  }
  ExpectRefused([other] { return kill(other, 0) < 0 ? errno : 0; }, EPERM);
  ExpectRefused([other] { return syscall(SYS_tgkill, other, other, 0) < 0 ? errno : 0; }, EPERM);
  ExpectRefused([other] { return syscall(SYS_pidfd_open, other, 0) < 0 ? errno : 0; }, EPERM);
  ExpectRefused([] { return ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) < 0 ? errno : 0; }, EPERM);
  kill(other, SIGKILL);
  waitpid(other, nullptr, 0);
}

// Refused outside too, unless the test runs as root, and then they might do harm.
TEST_F(SandboxTest, NothingOfTheKernel) {
  SKIP_WITHOUT(system_calls);
  EXPECT_EQ(Try([] { return mount("none", "/nowhere", "tmpfs", 0, nullptr) < 0 ? errno : 0; }, true), EPERM);
  EXPECT_EQ(Try([] { return syscall(SYS_bpf, 0, nullptr, 0) < 0 ? errno : 0; }, true), EPERM);
  EXPECT_EQ(Try([] { return unshare(CLONE_NEWUSER) < 0 ? errno : 0; }, true), EPERM);
  EXPECT_EQ(Try([] { return syscall(SYS_io_uring_setup, 1, nullptr) < 0 ? errno : 0; }, true), EPERM);
}

TEST_F(SandboxTest, FilesThatItWasTold) {
  SKIP_WITHOUT(files);
  ExpectAllowed([&] { return Open(scratch_ / "in/frame", O_RDONLY); });
  ExpectAllowed([&] { return Open(scratch_ / "options", O_RDONLY); });
  ExpectAllowed([&] { return Open(scratch_ / "out/made", O_WRONLY | O_CREAT); });
  ExpectAllowed([&] {
    mkdir((scratch_ / "out/folder").c_str(), 0755);
    if (Open(scratch_ / "out/folder/unfinished", O_WRONLY | O_CREAT) != 0) return 1;
    const int renamed = rename((scratch_ / "out/folder/unfinished").c_str(), (scratch_ / "out/finished").c_str());
    const int folder = open((scratch_ / "out").c_str(), O_RDONLY | O_DIRECTORY);
    return renamed == 0 && fsync(folder) == 0 ? unlink((scratch_ / "out/finished").c_str()) : 2;
  });
}

TEST_F(SandboxTest, NoOtherFiles) {
  SKIP_WITHOUT(files);
  ExpectRefused([&] { return Open(scratch_ / "other/database", O_RDONLY); }, EACCES);
  ExpectRefused([&] { return Open(scratch_ / "other/database", O_WRONLY); }, EACCES);
  ExpectRefused([&] { return Open(scratch_ / "in/frame", O_WRONLY); }, EACCES);
  ExpectRefused([&] { return Open(scratch_ / "in/new", O_WRONLY | O_CREAT); }, EACCES);
  ExpectRefused([&] { return Open(scratch_ / "in/../other/database", O_RDONLY); }, EACCES);
  ExpectRefused([] { return Open("/etc/passwd", O_RDONLY); }, EACCES);
  EXPECT_EQ(Try([] { return Open("/etc/shadow", O_RDONLY); }, true), EACCES);
  EXPECT_EQ(Try([&] { return unlink((scratch_ / "in/frame").c_str()) < 0 ? errno : 0; }, true), EACCES);
  ExpectRefused(
      [&] {
        unlink((scratch_ / "out/link").c_str());
        return symlink("/etc/passwd", (scratch_ / "out/link").c_str()) < 0 ? errno : 0;
      },
      EACCES);
  ASSERT_EQ(symlink("/etc/passwd", (scratch_ / "out/link").c_str()), 0);
  EXPECT_EQ(Try([&] { return Open(scratch_ / "out/link", O_RDONLY); }, true), EACCES);
  // The environment and the memory of the process that started it.
  const std::string parent = "/proc/" + std::to_string(getpid());
  ExpectRefused([&] { return Open(parent + "/environ", O_RDONLY); }, EACCES);
}

TEST_F(SandboxTest, NoModesAndOwners) {
  SKIP_WITHOUT(system_calls);
  ExpectRefused([&] { return chmod((scratch_ / "other/database").c_str(), 0600) < 0 ? errno : 0; }, EPERM);
  ExpectRefused([&] { return chown((scratch_ / "other/database").c_str(), getuid(), getgid()) < 0 ? errno : 0; },
                EPERM);
}

TEST_F(SandboxTest, NoPrivileges) {
  const auto status_word = [](const std::string& name) {
    std::ifstream file("/proc/self/status");
    for (std::string word, value; file >> word;) {
      if (word == name && file >> value) return value;
    }
    return std::string();
  };
  ExpectAllowed([&] { return status_word("CapEff:") == "0000000000000000" ? 0 : 1; });
  ExpectAllowed([&] { return status_word("CapBnd:") == "0000000000000000" || geteuid() != 0 ? 0 : 1; });
  ExpectAllowed([&] { return status_word("NoNewPrivs:") == "1" ? 0 : 1; });
}

// What a task does all the time.
TEST_F(SandboxTest, ThreadsPipesAndSignalsToItselfGoOn) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  ExpectAllowed([&] {
    int written = 0;
    std::thread([&] { written = static_cast<int>(write(ends[1], "line\n", 5)); }).join();
    signal(SIGUSR1, SIG_IGN);
    return written == 5 && raise(SIGUSR1) == 0 && kill(getpid(), 0) == 0 ? 0 : 1;
  });
  close(ends[0]);
  close(ends[1]);
}

TEST_F(SandboxTest, FolderToWriteToMustBeThere) {
  SKIP_WITHOUT(files);
  EXPECT_EQ(Try([] { return 0; }, true), 0);
  const int code = Try([&] { return absl::IsNotFound(EnterSandbox({.write = {scratch_ / "absent"}})) ? 0 : 1; },
                       /*inside=*/false);
  EXPECT_EQ(code, 0);
}

}  // namespace
}  // namespace depthtween
