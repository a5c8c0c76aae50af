// Backups made while another process runs jobs in the folder. fake_core writes of each frame what it is, so a frame of
// a restored job is right when it says its own name and number.
#include <signal.h>
#include <sys/wait.h>

#include <cstdio>

#include "server/store/backup.h"
#include "server/store/files.h"
#include "server/store/sqlite.h"
#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

using testing::IsEmpty;
using testing::SizeIs;

constexpr int kIntervals = 30, kWaitAt = 20;

std::string StemOf(int frame) { return absl::StrFormat("%06d", frame); }

class LiveBackupTest : public JobsFixture {
 protected:
  ~LiveBackupTest() override { EndServer(); }

  void SpawnServer() {
    const std::string data = folder_ / "data";
    server_ = fork();
    ASSERT_GE(server_, 0);
    if (server_ == 0) {
      execl(MANAGER_PROCESS, MANAGER_PROCESS, data.c_str(), FAKE_CORE, "1", nullptr);
      _exit(127);
    }
  }
  void EndServer() {
    if (server_ <= 0) return;
    kill(server_, SIGKILL);
    waitpid(server_, nullptr, 0);
    server_ = 0;
  }

  pid_t server_ = 0;
};

TEST_F(LiveBackupTest, EveryJobAndFrameIsThereAndWhatRanGoesOn) {
  Start();
  const std::string finished_on = ReadySequence(), running_on = ReadySequence("intervals 30\nwait_at 20\n");
  const std::string finished = NewJobOn(finished_on);
  ASSERT_EQ(Ended(finished).record.state, JobState::kSucceeded);
  jobs_.reset();
  const std::string running = Take(store_->CreateJob(kTenant, {.sequence_id = running_on}, "", false)).id;
  Close();

  SpawnServer();
  // Some while intervals are being finished, the last when the job stands still before interval 20.
  std::vector<std::string> backups;
  for (const int begun : {1, 5, 12, kWaitAt}) {
    WaitUntil([&] {
      const auto database = Take(Database::OpenToRead(folder_ / ("data/" + std::string(kDatabaseName))));
      return Take(database->Number("SELECT max(intervals_done) FROM jobs WHERE id = ?", {running})).value_or(0) >=
             begun;
    });
    backups.push_back(folder_ / absl::StrCat("backup-", begun));
    const BackupSummary summary = Take(MakeBackup(folder_ / "data", backups.back()));
    EXPECT_THAT(summary.faults, IsEmpty());
    EXPECT_EQ(summary.sequences, 2);
    EXPECT_EQ(summary.jobs, 2);
  }
  EXPECT_TRUE(IsAlive(server_)) << "the server took no notice";
  EndServer();

  int done_before = 0;
  for (const std::string& backup : backups) {
    const std::string restored = backup + "-restored";
    Take(RestoreBackup(backup, restored));
    std::string verdict;
    EXPECT_THAT(Take(Database::Open(restored + "/" + kDatabaseName))
                    ->Run("PRAGMA integrity_check", {}, [&](const SqlRow& row) { verdict += row.Text(0); }),
                IsOk());
    EXPECT_EQ(verdict, "ok");

    OpenStores(restored);
    const JobRecord left = Take(store_->GetJob(kTenant, running));
    EXPECT_EQ(left.state, JobState::kRunning);
    EXPECT_GE(left.intervals_done, done_before);
    done_before = left.intervals_done;
    const std::vector<FrameRecord> recorded = Take(store_->JobFrames(kTenant, running, 0, 2 * kIntervals));
    EXPECT_THAT(recorded, SizeIs(2 * kIntervals));
    for (const FrameRecord& frame : recorded) {
      if (!frame.ready) continue;
      EXPECT_EQ(ReadText(directory_->OutFolder(running) + "/depth/" + frame.stem + ".png"),
                absl::StrCat("depth ", frame.index));
    }

    Go(running_on);
    StartJobs();
    EXPECT_EQ(State(finished), JobState::kSucceeded);
    EXPECT_EQ(Ended(running).record.state, JobState::kSucceeded);
    for (int frame = 0; frame < 2 * kIntervals; ++frame) {
      EXPECT_EQ(Frame(running, "depth", StemOf(frame)), absl::StrCat("depth ", frame));
    }
    for (int frame = 0; frame < 6; ++frame) {
      EXPECT_EQ(Frame(finished, "uncertainty", StemOf(frame)), absl::StrCat("uncertainty ", frame));
    }
    // What was done before the backup was not computed again.
    EXPECT_THAT(Logged(running_on, "interval"), SizeIs(kIntervals - left.intervals_done));
    EXPECT_EQ(NamesIn(restored + "/quarantine"), std::vector<std::string>());
    Close();
  }
  EXPECT_EQ(done_before, kWaitAt);
}

}  // namespace
}  // namespace depthtween::server
