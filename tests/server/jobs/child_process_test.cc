// Children made of /bin/sh, whose behaviour is known.
#include "server/jobs/child_process.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

class ChildProcessTest : public testing::Test {
 protected:
  absl::StatusOr<ChildOutcome> Run(const std::string& script, std::stop_token stop = {}) {
    return RunChild({.arguments = {"/bin/sh", "-c", script},
                     .folder = folder_.path(),
                     .file_bytes = file_bytes_,
                     .cpu_seconds = cpu_seconds_,
                     .grace = absl::Milliseconds(200),
                     .stall_limit = stall_limit_},
                    stop, [this](std::string_view line) {
                      if (lines_.empty()) absl::SleepFor(slow_);
                      lines_.emplace_back(line);
                      return line != "enough";
                    });
  }
  TemporaryFolder folder_;
  int64_t file_bytes_ = 0, cpu_seconds_ = 0;
  absl::Duration stall_limit_ = absl::InfiniteDuration();
  absl::Duration slow_;  // that the listener is, at the first line
  std::vector<std::string> lines_;
};

TEST_F(ChildProcessTest, IsHeardToTheEnd) {
  const ChildOutcome outcome = Take(Run("echo one >&3; echo out; echo err >&2; printf 'two\\nunfinished' >&3; exit 7"));
  EXPECT_EQ(outcome.exit_code, 7);
  EXPECT_EQ(outcome.Describe(), "exit code 7");
  EXPECT_EQ(outcome.error_output, "err\n");
  EXPECT_EQ(ReadText(folder_ / "stdout"), "out\n");
  EXPECT_THAT(lines_, ElementsAre("one", "two"));
  EXPECT_FALSE(outcome.stopped);
}

TEST_F(ChildProcessTest, ManyLinesArriveWholeAndLongOnesAreCut) {
  EXPECT_EQ(Take(Run("i=0; while [ $i -lt 3000 ]; do echo line $i; i=$((i+1)); done >&3; head -c 100000 /dev/zero >&3; "
                     "echo >&3"))
                .exit_code,
            0);
  ASSERT_THAT(lines_, SizeIs(3001));
  EXPECT_EQ(lines_[2999], "line 2999");
  EXPECT_THAT(lines_[3000], SizeIs(64 << 10));
}

TEST_F(ChildProcessTest, SignalIsNamed) {
  const ChildOutcome outcome = Take(Run("kill -SEGV $$"));
  EXPECT_EQ(outcome.signal, SIGSEGV);
  EXPECT_THAT(outcome.Describe(), HasSubstr("SIGSEGV"));
}

TEST_F(ChildProcessTest, HasNothingOfOurs) {
  // Descriptors of ours that a child must not inherit, such as a client's connection.
  const int leaked = dup(STDIN_FILENO);
  EXPECT_EQ(Take(Run("ls /proc/self/fd | wc -l >&3; cat /proc/$$/oom_score_adj >&3")).exit_code, 0);
  close(leaked);
  // 0 to 3, and the one by which ls reads the folder.
  ASSERT_THAT(lines_, SizeIs(2));
  EXPECT_EQ(std::stoi(lines_[0]), 5);
  EXPECT_EQ(lines_[1], "500");
}

TEST_F(ChildProcessTest, KnowsNothingOfOurEnvironment) {
  ASSERT_EQ(setenv("DEPTHTWEEN_SECRET", "word", 1), 0);
  EXPECT_EQ(Take(Run("tr '\\0' '\\n' < /proc/$$/environ >&3; grep NoNewPrivs /proc/$$/status >&3")).exit_code, 0);
  unsetenv("DEPTHTWEEN_SECRET");
  // A build with sanitizers also hands on their own options, such as ASAN_OPTIONS, and nothing else.
  std::erase_if(lines_, [](const std::string& line) { return line.find("SAN_OPTIONS=") != std::string::npos; });
  EXPECT_THAT(lines_, ElementsAre("LANG=C", "NoNewPrivs:\t1"));
}

TEST_F(ChildProcessTest, FileLimitHolds) {
  file_bytes_ = 1000;
  const ChildOutcome outcome = Take(Run("head -c 5000 /dev/zero"));
  EXPECT_NE(outcome.exit_code, 0);
  EXPECT_EQ(ReadText(folder_ / "stdout").size(), 1000U);
}

TEST_F(ChildProcessTest, StopIsPoliteFirst) {
  std::stop_source stop;
  std::thread stopper([&] {
    WaitUntil([&] { return ReadText(folder_ / "stdout") == "ready\n"; });
    stop.request_stop();
  });
  const ChildOutcome outcome =
      Take(Run("trap 'echo stopping >&3; exit 3' TERM; echo ready; while true; do sleep 0.01; done", stop.get_token()));
  stopper.join();
  EXPECT_TRUE(outcome.stopped);
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(lines_, ElementsAre("stopping"));
}

TEST_F(ChildProcessTest, StopIsSureInTheEndAndForTheWholeGroup) {
  std::stop_source stop;
  std::thread stopper([&] {
    WaitUntil([&] { return ReadText(folder_ / "stdout").find("ready\n") != std::string::npos; });
    stop.request_stop();
  });
  const ChildOutcome outcome = Take(Run("trap '' TERM; sleep 1000 & echo $!; echo ready; wait", stop.get_token()));
  stopper.join();
  EXPECT_TRUE(outcome.stopped);
  EXPECT_EQ(outcome.signal, SIGKILL);
  const int grandchild = std::stoi(ReadText(folder_ / "stdout"));
  WaitUntil([&] { return !IsAlive(grandchild); });
}

TEST_F(ChildProcessTest, OneThatSaysNothingIsEnded) {
  stall_limit_ = absl::Milliseconds(100);
  const ChildOutcome outcome = Take(Run("trap '' TERM; echo one >&3; sleep 1000"));
  EXPECT_TRUE(outcome.stalled);
  EXPECT_FALSE(outcome.timed_out);
  EXPECT_EQ(outcome.signal, SIGKILL);
  EXPECT_THAT(lines_, ElementsAre("one"));
}

TEST_F(ChildProcessTest, SuspendedOneIsEndedToo) {
  stall_limit_ = absl::Milliseconds(100);
  const ChildOutcome outcome = Take(Run("kill -STOP $$"));
  EXPECT_TRUE(outcome.stalled);
  EXPECT_EQ(outcome.signal, SIGKILL);
}

// Many times as long as the limit, in short steps that it tells of. The listener's own time is not the child's.
TEST_F(ChildProcessTest, OneThatGoesOnTellingIsLeftAlone) {
  stall_limit_ = absl::Seconds(3);
  slow_ = absl::Milliseconds(3500);
  const ChildOutcome outcome = Take(Run("i=0; while [ $i -lt 16 ]; do sleep 0.25; echo $i >&3; i=$((i+1)); done"));
  EXPECT_FALSE(outcome.stalled);
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_THAT(lines_, SizeIs(16));
}

TEST_F(ChildProcessTest, ProcessorTimeIsLimited) {
  cpu_seconds_ = 1;
  const ChildOutcome outcome = Take(Run("while true; do :; done"));
  EXPECT_EQ(outcome.signal, SIGXCPU);
  EXPECT_FALSE(outcome.stopped);
}

TEST_F(ChildProcessTest, ListenerCanEndIt) {
  const ChildOutcome outcome = Take(Run("echo enough >&3; sleep 1000"));
  EXPECT_TRUE(outcome.stopped);
}

TEST_F(ChildProcessTest, GrandchildThatKeepsThePipeOpenDoesNotKeepUs) {
  EXPECT_EQ(Take(Run("sleep 1000 & exit 0")).exit_code, 0);
}

TEST_F(ChildProcessTest, ProgramThatDoesNotExistSaysSo) {
  const ChildOutcome outcome = Take(RunChild({.arguments = {"/no/such/program"}, .folder = folder_.path()}, {},
                                             [](std::string_view) { return true; }));
  EXPECT_EQ(outcome.exit_code, 127);
  EXPECT_THAT(outcome.error_output, HasSubstr("No such file"));
}

TEST_F(ChildProcessTest, LeftChildIsKilledOnlyIfItIsTheSame) {
  const pid_t left = fork();
  ASSERT_GE(left, 0);
  if (left == 0) {
    setpgid(0, 0);
    execl("/bin/sleep", "sleep", "1000", nullptr);
    _exit(127);
  }
  setpgid(left, left);
  const std::string stat = ReadText("/proc/" + std::to_string(left) + "/stat");
  const std::vector<std::string> fields = absl::StrSplit(stat.substr(stat.rfind(") ") + 2), ' ');
  // Same id, another start: a process that got the id later.
  WriteText(folder_ / "child", absl::StrCat(left, " 1\n"));
  KillLeftChild(folder_.path());
  EXPECT_TRUE(IsAlive(left));
  WriteText(folder_ / "child", "nonsense");
  KillLeftChild(folder_.path());
  EXPECT_TRUE(IsAlive(left));
  WriteText(folder_ / "child", absl::StrCat(left, " ", fields[19], "\n"));
  KillLeftChild(folder_.path());
  EXPECT_FALSE(IsAlive(left));
  EXPECT_EQ(waitpid(left, nullptr, 0), left);
}

}  // namespace
}  // namespace depthtween::server
