// depthtween-server as a process: what scripts and service managers see of it.
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <thread>

#include "server/rpc/health_check.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

class ServeTest : public testing::Test {
 protected:
  ~ServeTest() override {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      waitpid(pid_, nullptr, 0);
    }
  }

  void Spawn(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), DEPTHTWEEN_SERVER);
    std::vector<char*> pointers;
    for (std::string& argument : arguments) pointers.push_back(argument.data());
    pointers.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 1, (folder_ / "stdout").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    posix_spawn_file_actions_addopen(&actions, 2, (folder_ / "stderr").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    ASSERT_EQ(posix_spawn(&pid_, DEPTHTWEEN_SERVER, &actions, nullptr, pointers.data(), environ), 0);
    posix_spawn_file_actions_destroy(&actions);
  }
  // Starts a server on a free port and returns its address.
  std::string Serve() {
    std::filesystem::remove(folder_ / "port");
    Spawn({"serve", "--data-dir", folder_ / "data", "--listen", "127.0.0.1:0", "--port-file", folder_ / "port",
           "--core-binary", FAKE_CORE, "--workers", "1", "--reserved-disk-bytes", "0"});
    while (ReadText(folder_ / "port").empty() && waitpid(pid_, nullptr, WNOHANG) == 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    std::string port = ReadText(folder_ / "port");
    EXPECT_FALSE(port.empty()) << ReadText(folder_ / "stderr");
    if (!port.empty()) port.pop_back();
    return "127.0.0.1:" + port;
  }
  int ExitCode() {
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }
  int Run(const std::vector<std::string>& arguments) {
    Spawn(arguments);
    return ExitCode();
  }

  TemporaryFolder folder_;
  pid_t pid_ = 0;
};

TEST_F(ServeTest, SaysWhenItIsReadyAndEndsOnSigterm) {
  const std::string address = Serve();
  EXPECT_THAT(CheckHealth({.server = address, .timeout = absl::Seconds(60)}), IsOk());
  EXPECT_THAT(ReadText(folder_ / "stdout"), testing::HasSubstr("ready on " + address));
  kill(pid_, SIGTERM);
  EXPECT_EQ(ExitCode(), 0);
  EXPECT_THAT(CheckHealth({.server = address, .timeout = absl::Milliseconds(200)}),
              HasCode(absl::StatusCode::kUnavailable));
  // And again on the same folder.
  EXPECT_THAT(CheckHealth({.server = Serve(), .timeout = absl::Seconds(60)}), IsOk());
  kill(pid_, SIGINT);
  EXPECT_EQ(ExitCode(), 0);
}

TEST_F(ServeTest, BacksUpWhatItServesAndServesWhatWasRestored) {
  Serve();
  const pid_t server = std::exchange(pid_, 0);
  EXPECT_EQ(Run({"backup", "--data-dir", folder_ / "data", "--to", folder_ / "backup"}), 0)
      << ReadText(folder_ / "stderr");
  EXPECT_THAT(ReadText(folder_ / "stdout"), testing::HasSubstr("0 recordings, 0 jobs, 2 files"));
  EXPECT_EQ(Run({"backup", "--data-dir", folder_ / "data", "--to", folder_ / "backup"}), 1);
  EXPECT_THAT(ReadText(folder_ / "stderr"), testing::HasSubstr("exists"));
  kill(server, SIGTERM);
  waitpid(server, nullptr, 0);
  std::filesystem::remove_all(folder_ / "data");
  EXPECT_EQ(Run({"restore", "--from", folder_ / "backup", "--data-dir", folder_ / "data"}), 0);
  EXPECT_THAT(CheckHealth({.server = Serve(), .timeout = absl::Seconds(60)}), IsOk());
}

// Recordings are nobody else's to read, whatever the mask of the shell.
TEST_F(ServeTest, KeepsItsFilesToItself) {
  CheckHealth({.server = Serve(), .timeout = absl::Seconds(60)}).IgnoreError();
  for (const char* name : {"data", "data/sequences", "data/depthtween.sqlite"}) {
    const auto mode = std::filesystem::status(folder_ / name).permissions();
    EXPECT_EQ(mode & std::filesystem::perms(077), std::filesystem::perms::none) << name;
  }
  kill(pid_, SIGTERM);
  EXPECT_EQ(ExitCode(), 0);
}

TEST_F(ServeTest, HealthcheckIsAnExitCode) {
  const std::string address = Serve();
  const pid_t server = std::exchange(pid_, 0);
  EXPECT_EQ(Run({"healthcheck", "--server", address, "--timeout", "60"}), 0);
  kill(server, SIGTERM);
  waitpid(server, nullptr, 0);
  EXPECT_EQ(Run({"healthcheck", "--server", address, "--timeout", "0.2"}), 1);
  EXPECT_THAT(ReadText(folder_ / "stderr"), testing::HasSubstr(address));
}

TEST_F(ServeTest, WrongCommandLinesAreExplained) {
  EXPECT_EQ(Run({}), 2);
  EXPECT_EQ(Run({"serve"}), 2);
  EXPECT_THAT(ReadText(folder_ / "stderr"), testing::HasSubstr("--data-dir"));
  EXPECT_EQ(Run({"serve", "--data-dir", folder_ / "data", "--listen", "0.0.0.0:0", "--core-binary", FAKE_CORE}), 2);
  EXPECT_THAT(ReadText(folder_ / "stderr"), testing::HasSubstr("--insecure-listen-anywhere"));
  EXPECT_EQ(Run({"serve", "--data-dir", folder_ / "data", "--listen", "127.0.0.1:0", "--core-binary", "/none"}), 1);
  EXPECT_THAT(ReadText(folder_ / "stderr"), testing::HasSubstr("--core-binary"));
  for (const auto& [flag, value] : {std::pair("--workers", "0"),
                                    {"--threads", "-1"},
                                    {"--max-sequence-bytes", "0"},
                                    {"--task-memory-bytes", "-1GB"}}) {
    EXPECT_EQ(Run({"serve", "--data-dir", folder_ / "data", "--listen", "127.0.0.1:0", flag, value}), 2);
    EXPECT_THAT(ReadText(folder_ / "stderr"), testing::HasSubstr(std::string(flag) + ": " + value + ", must be"));
  }
  EXPECT_EQ(Run({"serve", "--data-dir", folder_ / "data", "--listen", "unix:/no/such/folder/socket"}), 1);
  EXPECT_THAT(ReadText(folder_ / "stderr"), testing::HasSubstr("folder of the socket"));
  EXPECT_EQ(Run({"--version"}), 0);
  EXPECT_THAT(ReadText(folder_ / "stdout"), testing::HasSubstr(DEPTHTWEEN_VERSION));
  EXPECT_EQ(Run({"serve", "--help"}), 0);
}

}  // namespace
}  // namespace depthtween::server
