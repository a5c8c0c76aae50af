// What is particular to the store on SQLite: its file, its schema, and what is left of it after a kill.
#include "server/store/sqlite_store.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <thread>

#include "server/store/schema.h"
#include "server/store/sqlite.h"
#include "tests/server/store/store_conformance.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

INSTANTIATE_TEST_SUITE_P(Sqlite, StoreConformance, testing::Values([](const std::string& folder, const Limits& limits) {
                           return Take(OpenSqliteStore(folder + "/store.sqlite", limits));
                         }),
                         [](const auto&) { return std::string("Store"); });

TEST(SqliteStore, SchemaIsBroughtUpToDateOnce) {
  const TemporaryFolder folder;
  EXPECT_THAT(OpenSqliteStore(folder / "s.sqlite", {}), IsOk());
  EXPECT_THAT(OpenSqliteStore(folder / "s.sqlite", {}), IsOk());
  const auto database = Take(Database::Open(folder / "s.sqlite"));
  EXPECT_EQ(Take(database->Number("PRAGMA user_version")), static_cast<int64_t>(SchemaSteps().size()));
}

// What a later version adds comes to a file that is in use, once, and its rows stay; a step that fails leaves the file
// as it was.
TEST(SqliteDatabase, MigratesWhatAnOlderVersionWrote) {
  const TemporaryFolder folder;
  const std::string first = "CREATE TABLE t (x INTEGER) STRICT",
                    second = "ALTER TABLE t ADD COLUMN y INTEGER DEFAULT 7";
  {
    const auto database = Take(Database::Open(folder / "d.sqlite"));
    EXPECT_THAT(database->Migrate({first}), IsOk());
    EXPECT_THAT(database->Run("INSERT INTO t VALUES (5)"), IsOk());
    EXPECT_THAT(database->Migrate({first, second, "no SQL"}), HasCode(absl::StatusCode::kInternal));
    EXPECT_EQ(Take(database->Number("PRAGMA user_version")), 1);
  }
  const auto database = Take(Database::Open(folder / "d.sqlite"));
  for (int starts = 0; starts < 2; ++starts) EXPECT_THAT(database->Migrate({first, second}), IsOk());
  EXPECT_EQ(Take(database->Number("SELECT 10 * x + y FROM t")), 57);
  EXPECT_EQ(Take(database->Number("PRAGMA user_version")), 2);
}

TEST(SqliteStore, CopiesTheFileBeforeItMigrates) {
  const TemporaryFolder folder;
  {
    const auto older = Take(Database::Open(folder / "s.sqlite"));
    EXPECT_THAT(older->Migrate({SchemaSteps().front()}), IsOk());
  }
  EXPECT_THAT(OpenSqliteStore(folder / "s.sqlite", {}), IsOk());
  const auto copy = Take(Database::Open(folder / "s.sqlite.schema-1"));
  EXPECT_EQ(Take(copy->SchemaVersion()), 1);
  EXPECT_EQ(Take(copy->Number("SELECT count(*) FROM sequences")), 0);
}

// Another process writes, as an operator's shell does: reads do not wait for it, and writes wait a little.
TEST(SqliteStore, OutlastsALockFromOutside) {
  const TemporaryFolder folder;
  const auto store = Take(OpenSqliteStore(folder / "s.sqlite", {}));
  const SequenceRecord made = Take(store->CreateSequence(kTenant, "before", ""));
  const auto outside = Take(Database::Open(folder / "s.sqlite"));
  EXPECT_THAT(outside->Run("BEGIN IMMEDIATE"), IsOk());
  EXPECT_EQ(Take(store->GetSequence(kTenant, made.id)).display_name, "before");
  EXPECT_EQ(Take(store->ListSequences(kTenant, {}, {})).items.size(), 1U);
  std::thread release([&outside] {
    usleep(200'000);
    EXPECT_THAT(outside->Run("COMMIT"), IsOk());
  });
  EXPECT_THAT(store->CreateSequence(kTenant, "after", ""), IsOk());
  release.join();
}

TEST(SqliteStore, RefusesTheFileOfANewerServer) {
  const TemporaryFolder folder;
  EXPECT_THAT(OpenSqliteStore(folder / "s.sqlite", {}), IsOk());
  EXPECT_THAT(Take(Database::Open(folder / "s.sqlite"))->RunScript("PRAGMA user_version = 1000"), IsOk());
  const auto opened = OpenSqliteStore(folder / "s.sqlite", {});
  EXPECT_THAT(opened, HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(std::string(opened.status().message()), HasSubstr("newer"));
}

TEST(SqliteStore, RefusesAFileThatIsNoDatabase) {
  const TemporaryFolder folder;
  WriteText(folder / "s.sqlite", std::string(5000, 'x'));
  EXPECT_THAT(OpenSqliteStore(folder / "s.sqlite", {}), HasCode(absl::StatusCode::kDataLoss));
}

TEST(SqliteDatabase, FailedTransactionLeavesNothing) {
  const TemporaryFolder folder;
  const auto database = Take(Database::Open(folder / "d.sqlite"));
  EXPECT_THAT(database->RunScript("CREATE TABLE t (x INTEGER) STRICT"), IsOk());
  const absl::Status status = database->Transact([&]() -> absl::Status {
    RETURN_IF_ERROR(database->Run("INSERT INTO t VALUES (1)"));
    return database->Run("INSERT INTO t VALUES ('text')");
  });
  EXPECT_THAT(status, HasCode(absl::StatusCode::kInternal));
  EXPECT_EQ(Take(database->Number("SELECT count(*) FROM t")), 0);
}

// A process that makes sequences as fast as it can, saying each id once it was acknowledged, is killed in the middle:
// every id it said is there afterwards.
TEST(SqliteStore, WhatWasAcknowledgedSurvivesAKill) {
  const TemporaryFolder folder;
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const auto store = OpenSqliteStore(folder / "s.sqlite", {});
    while (store.ok()) {
      const auto made = (*store)->CreateSequence(kTenant, "", "");
      if (!made.ok() || write(ends[1], made->id.data(), 16) != 16) break;
    }
    _exit(1);
  }
  close(ends[1]);
  std::vector<std::string> acknowledged;
  std::string id(16, ' ');
  while (read(ends[0], id.data(), 16) == 16) {
    acknowledged.push_back(id);
    if (acknowledged.size() == 50) kill(child, SIGKILL);
  }
  close(ends[0]);
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  ASSERT_GE(acknowledged.size(), 50U);
  const auto store = Take(OpenSqliteStore(folder / "s.sqlite", {}));
  for (const std::string& made : acknowledged) EXPECT_THAT(store->GetSequence(kTenant, made), IsOk());
}

TEST(SqliteDatabase, FullDatabaseIsAFullDisk) {
  const TemporaryFolder folder;
  const auto database = Take(Database::Open(folder / "d.sqlite"));
  EXPECT_THAT(database->RunScript("CREATE TABLE t (x TEXT) STRICT; PRAGMA max_page_count = 4"), IsOk());
  EXPECT_THAT(database->Run("INSERT INTO t VALUES (?)", {std::string(100'000, 'x')}),
              HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
}

// A disk of one megabyte that is really full.
TEST(SqliteStore, FullDiskIsAStatusAndHarmsNothing) {
  const SmallDisk disk("1m");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  auto store = Take(OpenSqliteStore(disk.path() + "/s.sqlite", {}));
  const SequenceRecord before = Take(store->CreateSequence(kTenant, "before", ""));
  WriteText(disk.path() + "/filler", std::string(2 << 20, 'x'));
  absl::Status failure;
  for (int made = 0; made < 1000 && failure.ok(); ++made) failure = store->CreateSequence(kTenant, "", "").status();
  EXPECT_THAT(failure, HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
  store.reset();
  store = Take(OpenSqliteStore(disk.path() + "/s.sqlite", {}));  // a server starts there, too
  EXPECT_EQ(Take(store->GetSequence(kTenant, before.id)).display_name, "before");
  std::filesystem::remove(disk.path() + "/filler");
  EXPECT_THAT(store->CreateSequence(kTenant, "after", ""), IsOk()) << "with room again it goes on";
}

}  // namespace
}  // namespace depthtween::server
