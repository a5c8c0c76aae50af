// What is particular to the store on SQLite: its file, its schema, and what is left of it after a kill.
#include "server/store/sqlite_store.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "absl/strings/str_format.h"
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

// A file of the first schema, with work in it, is brought up to date: nothing is lost, and the numbers of tasks go on.
TEST(SqliteStore, WorkOfAnOlderServerGoesOn) {
  const TemporaryFolder folder;
  {
    const auto database = Take(Database::Open(folder / "s.sqlite"));
    EXPECT_THAT(database->RunScript(SchemaSteps()[0]), IsOk());
    EXPECT_THAT(database->RunScript(R"(
      INSERT INTO sequences (id, display_name, state, create_time_us, update_time_us) VALUES ('s', '', 2, 0, 0);
      INSERT INTO tasks (kind, sequence) VALUES (1, 1), (1, 1), (1, 1);
      DELETE FROM tasks WHERE number <> 2;
      PRAGMA user_version = 1)"),
                IsOk());
  }
  const auto store = Take(OpenSqliteStore(folder / "s.sqlite", {}));
  const auto all = [](const JobRecord&, TaskKind) { return 1; };
  EXPECT_EQ(Take(store->ClaimTask(all))->number, 2);
  EXPECT_THAT(store->FinishValidation(2, {.error = absl::InternalError("x")}), IsOk());
  const SequenceRecord sequence = Take(store->CreateSequence("", ""));
  const UploadRecord upload = Take(store->CreateUpload(sequence.id, {{.path = "f"}}, 1, ""));
  EXPECT_THAT(store->FinishUpload(upload.id), IsOk());
  EXPECT_THAT(store->CommitSequence(sequence.id), IsOk());
  EXPECT_EQ(Take(store->ClaimTask(all))->number, 4) << "3 was used, even if its row is gone";
}

// The file of a server that knew `version` steps, with a sequence "s" that is ready, a job "j" that runs, and what
// `script` adds.
void WriteOldFile(const std::string& file, int version, const std::string& script) {
  const auto database = Take(Database::Open(file));
  for (int step = 0; step < version; ++step) EXPECT_THAT(database->RunScript(SchemaSteps()[step]), IsOk());
  EXPECT_THAT(database->RunScript(R"(
      INSERT INTO sequences (id, display_name, state, create_time_us, update_time_us, validation) VALUES
        ('s', '', 3, 0, 0, '{"violations": [], "warnings": [], "error": {"code": 0, "message": ""}, "recording":
          {"camera": {"width": 4, "height": 3, "fx": 5, "fy": 5, "cx": 1.5, "cy": 1, "k1": 0, "k2": 0, "p1": 0,
           "p2": 0, "k3": 0}, "depth_scale": 5000, "color_frame_count": 4, "depth_frame_count": 2,
           "first_time_ns": 0, "last_time_ns": 3, "median_depth_m": 1}}');
      INSERT INTO jobs (id, display_name, sequence_id, recording, method, key_every, threads, state, create_time_us,
                        intervals_total, intervals_done, frames_total, frames_done, preset, without)
        SELECT 'j', 'old', 's', json_extract(validation, '$.recording'), 'ours', 2, 0, 2, 7, 2, 1, 4, 2, 'fast', 'draw'
        FROM sequences;)"),
              IsOk());
  EXPECT_THAT(database->RunScript(script), IsOk());
  EXPECT_THAT(database->RunScript(absl::StrFormat("PRAGMA user_version = %d", version)), IsOk());
}

// A file of the schema before self-checks, with a job that runs: it reads as it was, and its work goes on.
TEST(SqliteStore, JobsFromBeforeSelfChecksGoOn) {
  const TemporaryFolder folder;
  WriteOldFile(folder / "s.sqlite", 3, R"(
      INSERT INTO tasks (kind, job, first_interval, interval_count, running, render) VALUES
        (2, 1, 0, 0, 0, 0), (3, 1, 0, 1, 0, 0), (5, 1, 1, 1, 1, 3);
      DELETE FROM tasks WHERE number < 3;
      INSERT INTO intervals (job, idx, first_frame, frame_count, held, done) VALUES (1, 0, 0, 2, 0, 1), (1, 1, 2, 2, 0, 0)
      )");
  const auto store = Take(OpenSqliteStore(folder / "s.sqlite", {}));
  const JobRecord job = Take(store->GetJob("j"));
  EXPECT_EQ(job.display_name, "old");
  EXPECT_EQ(job.options.key_every, 2);
  EXPECT_EQ(job.options.preset, "fast");
  EXPECT_EQ(job.options.without, std::vector<std::string>{"draw"});
  EXPECT_EQ(job.intervals_done, 1);
  EXPECT_FALSE(job.options.self_check);
  EXPECT_FALSE(job.self_check.has_value());
  EXPECT_THAT(store->ReleaseTask(3), IsOk()) << "the task that ran is there";
  const auto one = [](const JobRecord&, TaskKind) { return 1; };
  const Task next = *Take(store->ClaimTask(one));
  EXPECT_EQ(next.kind, TaskKind::kIntervals);
  EXPECT_EQ(next.first_interval, 1);
  EXPECT_EQ(next.number, 4) << "numbers go on";
  EXPECT_THAT(store->CreateJob({.sequence_id = "s", .options = {.self_check = true}}, "", false), IsOk());
  EXPECT_EQ(Take(store->ClaimTask(one))->kind, TaskKind::kSelfCheck);
}

// A file of the schema before clocks: its jobs take depth stamps as they are, and keep what they measured.
TEST(SqliteStore, JobsFromBeforeClocksGoOn) {
  const TemporaryFolder folder;
  WriteOldFile(folder / "s.sqlite", 4, R"(
      UPDATE jobs SET self_check = 1, self_check_result = '{"summary": "s", "reason": "too short"}';
      INSERT INTO tasks (kind, job) VALUES (6, 1))");
  const auto store = Take(OpenSqliteStore(folder / "s.sqlite", {}));
  const JobRecord job = Take(store->GetJob("j"));
  EXPECT_EQ(job.options.clock, "stamps");
  EXPECT_FALSE(job.options.causal);
  EXPECT_FALSE(job.options.scene_flow);
  EXPECT_FALSE(job.scene_flow_options.has_value());
  EXPECT_FALSE(job.clock_estimate.has_value());
  EXPECT_TRUE(job.options.self_check);
  EXPECT_EQ(job.self_check->reason, "too short");
  EXPECT_EQ(Take(store->ClaimTask([](const JobRecord&, TaskKind) { return 1; }))->kind, TaskKind::kSelfCheck);
}

// A file of the schema before choices as printed: its jobs have none, scene flow jobs stay such, and new jobs may.
TEST(SqliteStore, JobsFromBeforeChoicesAsPrintedGoOn) {
  const TemporaryFolder folder;
  WriteOldFile(folder / "s.sqlite", 7, R"(
      INSERT INTO jobs (id, display_name, sequence_id, recording, method, key_every, threads, state, create_time_us,
                        scene_flow_options)
        SELECT 'f', '', sequence_id, recording, method, 1, 0, 1, 8,
               '{"method": "pd-flow", "formats": ["npz"], "every": 2, "baseline_m": 0.1}' FROM jobs;
      UPDATE jobs SET preset = 'reference', scene_flow = 1 WHERE id = 'j';
      INSERT INTO tasks (kind, job) VALUES (2, 1))");
  const auto store = Take(OpenSqliteStore(folder / "s.sqlite", {}));
  const JobRecord job = Take(store->GetJob("j"));
  EXPECT_EQ(job.options.preset, "reference");
  EXPECT_TRUE(job.options.literal.empty());
  EXPECT_TRUE(job.options.scene_flow);
  const JobRecord flow = Take(store->GetJob("f"));
  EXPECT_EQ(flow.scene_flow_options->method, "pd-flow");
  EXPECT_EQ(flow.queue_position, 1);
  const UpsampleOptions printed = {.preset = "reference", .literal = {"proj", "topology"}};
  EXPECT_EQ(Take(store->CreateJob({.sequence_id = "s", .options = printed}, "", false)).options.literal,
            printed.literal);
}

// A file of the schema before assembled frames were recorded: of its frames nobody knows.
TEST(SqliteStore, FramesFromBeforeTheyWereRecordedStay) {
  const TemporaryFolder folder;
  WriteOldFile(folder / "s.sqlite", 8, R"(
      INSERT INTO intervals (job, idx, first_frame, frame_count, held, done) VALUES (1, 0, 0, 2, 0, 1);
      INSERT INTO frames (job, idx, time_ns, stem, interval) VALUES (1, 0, 5, 'a', 0), (1, 1, 6, 'b', 0))");
  const auto store = Take(OpenSqliteStore(folder / "s.sqlite", {}));
  const std::vector<FrameRecord> frames = Take(store->JobFrames("j", 0, 10));
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[1].stem, "b");
  EXPECT_TRUE(frames[1].ready);
  EXPECT_FALSE(frames[1].assembled.has_value());
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
      const auto made = (*store)->CreateSequence("", "");
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
  for (const std::string& made : acknowledged) EXPECT_THAT(store->GetSequence(made), IsOk());
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
  if (!disk.mounted()) GTEST_SKIP() << "mounting a tmpfs is not permitted here";
  const auto store = Take(OpenSqliteStore(disk.path() + "/s.sqlite", {}));
  const SequenceRecord before = Take(store->CreateSequence("before", ""));
  WriteText(disk.path() + "/filler", std::string(2 << 20, 'x'));
  absl::Status failure;
  for (int made = 0; made < 1000 && failure.ok(); ++made) failure = store->CreateSequence("", "").status();
  EXPECT_THAT(failure, HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
  EXPECT_EQ(Take(store->GetSequence(before.id)).display_name, "before");
  std::filesystem::remove(disk.path() + "/filler");
  EXPECT_THAT(store->CreateSequence("after", ""), IsOk()) << "with room again it goes on";
}

}  // namespace
}  // namespace depthtween::server
