// Tasks of a host of fake_core: what they do is known, and where they come from is asked of /proc.
#include "server/jobs/task_host.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <filesystem>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "server/jobs/child_process.h"
#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

class TaskHostTest : public testing::Test {
 protected:
  // Until there is a host: then it is not the caller who must start the program. 0 if there is none for a minute.
  pid_t LaunchWhenReady(TaskHost& host, const std::vector<std::string>& arguments, int progress) {
    for (int i = 0; i < 6000; ++i) {
      const std::optional<pid_t> task =
          Take(host.Launch(arguments, {}, {.progress = progress, .output = nothing_, .error_output = nothing_}));
      if (task) return *task;
      absl::SleepFor(absl::Milliseconds(10));
    }
    return 0;
  }
  static int ExitCode(pid_t task) {
    int status = -1;
    EXPECT_EQ(waitpid(task, &status, 0), task);
    return WEXITSTATUS(status);
  }
  // The host, by the name it gives itself.
  static pid_t FindHost() {
    for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
      pid_t id = 0;
      if (!absl::SimpleAtoi(entry.path().filename().string(), &id)) continue;
      if (ReadText((entry.path() / "comm").string()) != "task-host\n") continue;
      // "... (task-host) STATE PARENT ...": it may run or sleep.
      const std::string stat = ReadText((entry.path() / "stat").string()), name_end = "(task-host) ";
      const size_t state = stat.find(name_end);
      if (state == std::string::npos) continue;
      if (absl::StartsWith(stat.substr(state + name_end.size() + 1), absl::StrCat(" ", getpid(), " "))) return id;
    }
    return 0;
  }

  const int nothing_ = open("/dev/null", O_WRONLY | O_CLOEXEC);
};

TEST_F(TaskHostTest, LaunchesChildrenOfThisProcess) {
  TaskHost host(FAKE_CORE);
  const pid_t task = LaunchWhenReady(host, {FAKE_CORE, "no task"}, nothing_);
  ASSERT_GT(task, 0);
  EXPECT_EQ(ExitCode(task), 2);  // as fake_core does it
}

TEST_F(TaskHostTest, AnotherHostComesWhenOneDies) {
  TaskHost host(FAKE_CORE, absl::Milliseconds(1));
  EXPECT_EQ(ExitCode(LaunchWhenReady(host, {FAKE_CORE, "no task"}, nothing_)), 2);
  const pid_t first = FindHost();
  ASSERT_GT(first, 0);
  kill(first, SIGKILL);
  while (kill(first, 0) == 0) absl::SleepFor(absl::Milliseconds(1));
  EXPECT_EQ(ExitCode(LaunchWhenReady(host, {FAKE_CORE, "no task"}, nothing_)), 2);
  EXPECT_NE(FindHost(), first);
}

TEST_F(TaskHostTest, AProgramThatHostsNothingIsNoMatter) {
  TaskHost host("/bin/false", absl::Milliseconds(1));
  absl::SleepFor(absl::Milliseconds(50));
  EXPECT_EQ(Take(host.Launch({"/bin/false"}, {}, {nothing_, nothing_, nothing_})), std::nullopt);
}

TEST_F(TaskHostTest, ItsTasksDieWithIt) {
  TemporaryFolder sequence;
  std::ofstream(sequence / "script") << "hang 1 1\n";
  std::array<int, 2> progress{};
  ASSERT_EQ(pipe2(progress.data(), O_CLOEXEC), 0);
  pid_t task = 0;
  {
    TaskHost host(FAKE_CORE);
    task = LaunchWhenReady(host, {FAKE_CORE, "task", "validate", "--sequence", sequence.path(), "--progress-fd", "3"},
                           progress[1]);
    ASSERT_GT(task, 0);
    // Until it has said a word, and so is bound to the host's thread.
    char word = 0;
    ASSERT_EQ(read(progress[0], &word, 1), 1);
  }
  int status = 0;
  EXPECT_EQ(waitpid(task, &status, 0), task);
  EXPECT_EQ(WTERMSIG(status), SIGKILL);
}

}  // namespace
}  // namespace depthtween::server
