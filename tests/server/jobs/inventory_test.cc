// A start after the database was lost, restored or mixed up: no recording and no job is deleted. What must be there is
// what the test itself wrote before.
#include "server/jobs/inventory.h"

#include "server/store/files.h"
#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::SizeIs;

class InventoryTest : public JobsFixture {
 protected:
  std::string Data(const std::string& name) const { return folder_ / ("data/" + name); }
  // A recording with a job that has ended.
  std::string Work() {
    const std::string sequence = ReadySequence();
    EXPECT_EQ(Ended(NewJobOn(sequence)).record.state, JobState::kSucceeded);
    return sequence;
  }
  void RemoveDatabase() {
    for (const char* end : {"", "-wal", "-shm"}) fs::remove(Data("depthtween.sqlite") + end);
  }
  absl::Status TryStart(bool accept_new_store) {
    OpenStores(folder_ / "data");
    auto jobs = JobManager::Start(*directory_, *store_,
                                  {.core_program = FAKE_CORE, .workers = 1, .accept_new_store = accept_new_store});
    if (jobs.ok()) jobs_ = *std::move(jobs);
    return jobs.status();
  }
  // The one thing in quarantine whose name ends so; its path.
  std::string Quarantined(const std::string& end) const {
    std::string found;
    for (const std::string& name : NamesIn(Data("quarantine"))) {
      if (name.size() > end.size() && name.substr(name.size() - end.size()) == end) found = Data("quarantine/" + name);
    }
    EXPECT_NE(found, "") << end;
    return found;
  }
};

TEST_F(InventoryTest, ALostDatabaseCostsNoFile) {
  Start();
  const std::string sequence = Work();
  Close();
  for (const bool emptied : {false, true}) {
    RemoveDatabase();
    if (emptied) WriteText(Data("depthtween.sqlite"), "");
    const absl::Status refused = TryStart(/*accept_new_store=*/false);
    EXPECT_THAT(refused, HasCode(absl::StatusCode::kFailedPrecondition));
    EXPECT_THAT(std::string(refused.message()), HasSubstr("1 recordings and 1 jobs"));
    EXPECT_THAT(std::string(refused.message()), HasSubstr("--new-database"));
    Close();
    EXPECT_TRUE(fs::exists(Data("sequences/" + sequence + "/script")));
    EXPECT_THAT(NamesIn(Data("jobs")), SizeIs(1));
  }
  EXPECT_THAT(TryStart(/*accept_new_store=*/true), IsOk());
  EXPECT_THAT(NamesIn(Data("quarantine")), SizeIs(2));
  EXPECT_TRUE(fs::exists(Quarantined("-sequences-" + sequence) + "/script"));
  Work();  // it goes on
  Close();
  EXPECT_THAT(TryStart(/*accept_new_store=*/false), IsOk()) << "the new database is the folder's own now";
}

// As after an operator put yesterday's backup back.
TEST_F(InventoryTest, ARestoredDatabaseKeepsWhatItDoesNotKnow) {
  Start();
  const std::string known = Work();
  Close();
  fs::copy_file(Data("depthtween.sqlite"), folder_ / "yesterday");
  Start();
  const std::string later = Work();
  Close();
  RemoveDatabase();
  fs::copy_file(folder_ / "yesterday", Data("depthtween.sqlite"));
  Start();
  EXPECT_EQ(Take(sequences_->Get(kTenant, known)).state, SequenceState::kReady);
  EXPECT_TRUE(fs::exists(Data("sequences/" + known + "/script")));
  EXPECT_THAT(NamesIn(Data("jobs")), SizeIs(1));
  EXPECT_THAT(NamesIn(Data("quarantine")), SizeIs(2));
  EXPECT_TRUE(fs::exists(Quarantined("-sequences-" + later) + "/script"));
}

TEST_F(InventoryTest, ADatabaseOfAnotherFolderIsRefused) {
  Start();
  Work();
  Close();
  fs::copy_file(Data("depthtween.sqlite"), folder_ / "other");
  fs::remove_all(Data(""));
  Start();
  Work();
  Close();
  RemoveDatabase();
  fs::copy_file(folder_ / "other", Data("depthtween.sqlite"));
  for (const bool accept : {false, true}) {
    const absl::Status refused = TryStart(accept);
    EXPECT_THAT(refused, HasCode(absl::StatusCode::kFailedPrecondition));
    EXPECT_THAT(std::string(refused.message()), HasSubstr("another data folder"));
    Close();
  }
  EXPECT_THAT(NamesIn(Data("jobs")), SizeIs(1));
}

}  // namespace
}  // namespace depthtween::server
