// Disks that fail in known ways, by a mount that forbids writing and by a disk in memory under the database: what each
// means for the health follows from the header.
#include "server/jobs/health_probe.h"

#include <sys/mount.h>

#include "server/store/files.h"
#include "tests/server/jobs/jobs_fixture.h"
#include "tests/server/store/faults/faulty_disk.h"

namespace depthtween::server {
namespace {

class HealthProbeTest : public JobsFixture {
 protected:
  // Until its end the folder can be read alone.
  class ReadOnly {
   public:
    explicit ReadOnly(std::string folder) : folder_(std::move(folder)) {
      const char* const path = folder_.c_str();
      mounted_ = mount(path, path, nullptr, MS_BIND, nullptr) == 0;
      made_ = mounted_ && mount(nullptr, path, nullptr, MS_BIND | MS_REMOUNT | MS_RDONLY, nullptr) == 0;
    }
    ~ReadOnly() {
      if (mounted_) umount2(folder_.c_str(), MNT_DETACH);
    }
    ReadOnly(const ReadOnly&) = delete;
    ReadOnly& operator=(const ReadOnly&) = delete;
    bool made() const { return made_; }

   private:
    const std::string folder_;
    bool mounted_ = false, made_ = false;
  };

  DamageLog damage_;
};

TEST_F(HealthProbeTest, AFolderThatCannotBeWrittenIsNotReady) {
  OpenStores(folder_ / "data");
  Health health;
  health.Set("", true);
  auto probe = std::make_unique<HealthProbe>(*store_, *directory_, damage_, health, absl::Milliseconds(5));
  {
    const ReadOnly folder(directory_->path());
    ASSERT_TRUE(folder.made()) << kNeedsMount;
    EXPECT_THAT(ProbeDisk(*store_, *directory_, damage_), HasCode(absl::StatusCode::kInternal));
    WaitUntil([&] { return health.IsServing("") == false; });
  }
  WaitUntil([&] { return health.IsServing("") == true; });
  health.StopServing();
  usleep(20'000);
  EXPECT_EQ(health.IsServing(""), false) << "a good disk does not undo the end of service";
  probe.reset();
  EXPECT_THAT(NamesIn(directory_->TasksFolder()), testing::IsEmpty());
}

TEST_F(HealthProbeTest, WhatADatabaseOnABadDiskMeans) {
  directory_ = Take(DataDirectory::Open(folder_ / "data"));
  FaultyDisk disk(/*seed=*/1);
  auto store = Take(OpenSqliteStore("/probed.sqlite", {}));
  EXPECT_THAT(store->SetFolderId("x"), IsOk());
  EXPECT_THAT(ProbeDisk(*store, *directory_, damage_), IsOk());
  for (const FaultKind kind : {FaultKind::kWriteError, FaultKind::kSyncError}) {
    disk.Arm(kind, 0, /*lasts=*/true);
    EXPECT_THAT(ProbeDisk(*store, *directory_, damage_), HasCode(absl::StatusCode::kInternal)) << ToString(kind);
    disk.Repair();
    EXPECT_THAT(ProbeDisk(*store, *directory_, damage_), IsOk());
  }
  disk.Arm(FaultKind::kFull, 0, /*lasts=*/true);
  EXPECT_THAT(ProbeDisk(*store, *directory_, damage_), IsOk()) << "a full disk serves";
  EXPECT_TRUE(disk.struck());
  disk.Repair();

  damage_.Report(kDatabaseName, "found by the scrub");
  EXPECT_THAT(ProbeDisk(*store, *directory_, damage_), HasCode(absl::StatusCode::kDataLoss));
}

// One call finds damage, and from then on the store says so whatever it is asked to probe.
TEST_F(HealthProbeTest, DamageThatAnyCallHasMetIsRemembered) {
  const std::string file = folder_ / "s.sqlite";
  directory_ = Take(DataDirectory::Open(folder_ / "data"));
  {
    auto store = Take(OpenSqliteStore(file, {}));
    EXPECT_THAT(store->SetFolderId("x"), IsOk());
    for (int i = 0; i < 200; ++i) EXPECT_THAT(store->CreateSequence(kTenant, std::string(100, 'x'), ""), IsOk());
  }
  EXPECT_THAT(CheckSqliteFile(file), IsOk());
  // The database's pages but the first ones, which hold the schema, and the id of the folder, which the probe writes.
  std::string bytes = ReadText(file);
  const size_t names = bytes.find(std::string(100, 'x'));
  ASSERT_NE(names, std::string::npos);
  bytes.replace(names / 4096 * 4096, 4096, 4096, '\x55');
  WriteText(file, bytes);
  std::filesystem::remove(file + "-wal");  // whose pages would be read in the place of these
  EXPECT_THAT(CheckSqliteFile(file), HasCode(absl::StatusCode::kDataLoss));
  auto store = Take(OpenSqliteStore(file, {}));
  EXPECT_THAT(ProbeDisk(*store, *directory_, damage_), IsOk());
  EXPECT_THAT(store->ListSequences(kTenant, {}, {.size = 1000}), HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(ProbeDisk(*store, *directory_, damage_), HasCode(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace depthtween::server
