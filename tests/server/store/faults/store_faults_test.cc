// The store on a disk that fails: at every single I/O of every kind of operation, by every kind of fault.
//
// How the truth is known: each operation is first done on a good disk, from the same state. Whatever fails then may
// leave the records as they were before it or as they are after it, and nothing else; what was acknowledged must be as
// after it. Records are compared column by column, but for random ids and times. SQLite judges its file itself
// (PRAGMA integrity_check).
#include <malloc.h>
#include <sqlite3.h>

#include <functional>
#include <iostream>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "server/store/sqlite_store.h"
#include "tests/server/server_fixtures.h"
#include "tests/server/store/faults/faulty_disk.h"

namespace depthtween::server {
namespace {

constexpr char kFile[] = "/store.sqlite";
#ifdef DEPTHTWEEN_SANITIZED
constexpr int kOperations = 20;
constexpr int kFlips = 50;
#else
constexpr int kOperations = 80;
constexpr int kFlips = 500;
#endif
constexpr int kPoints = 7;  // of each kind of fault in one operation, where there are more

// A look at the file beside the store, that leaves no trace in it.
class Reader {
 public:
  Reader() {
    EXPECT_EQ(sqlite3_open_v2(kFile, &connection_, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
    sqlite3_db_config(connection_, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  }
  ~Reader() { sqlite3_close(connection_); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  std::vector<std::vector<std::string>> Rows(const std::string& sql) {
    std::vector<std::vector<std::string>> rows;
    sqlite3_stmt* statement = nullptr;
    int code = sqlite3_prepare_v2(connection_, sql.c_str(), -1, &statement, nullptr);
    while (code == SQLITE_OK || code == SQLITE_ROW) {
      code = sqlite3_step(statement);
      if (code != SQLITE_ROW) break;
      std::vector<std::string>& row = rows.emplace_back();
      for (int column = 0; column < sqlite3_column_count(statement); ++column) {
        const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement, column));
        row.emplace_back(text == nullptr ? "NULL" : text);
      }
    }
    if (code != SQLITE_DONE) rows.push_back({"damaged:", sqlite3_errmsg(connection_)});
    sqlite3_finalize(statement);
    return rows;
  }

  // Everything but ids and times.
  std::string Everything() {
    std::string text;
    for (const char* sql : {
             "SELECT number, display_name, state, size_bytes, file_count, validation, tenant FROM sequences",
             "SELECT number, sequence, size_bytes, committed_size, finished FROM uploads",
             "SELECT sequence, path, upload, position, size_bytes, hex(sha256), hex(checksums) FROM files",
             "SELECT j.number, j.display_name, s.number, j.recording, j.kind, j.options, j.threads, j.state, "
             "j.attempt, j.error_code, j.error_message, j.intervals_total, j.intervals_done, j.frames_total, "
             "j.frames_done, j.interval_seconds, j.self_check, j.clock_estimate, j.warnings, j.tenant, j.priority, "
             "j.start_time_us IS NULL, j.end_time_us IS NULL "
             "FROM jobs j LEFT JOIN sequences s ON s.id = j.sequence_id ORDER BY j.number",
             "SELECT number, kind, sequence, job, running, failures, first_interval, interval_count, render FROM tasks",
             "SELECT * FROM intervals",
             "SELECT * FROM frames",
             "SELECT * FROM renders",
             "SELECT * FROM render_parts",
             "SELECT job, path, size_bytes, hex(checksums) FROM job_files",
             "SELECT request_id FROM requests ORDER BY request_id",
             "SELECT * FROM tenants",
             "SELECT * FROM scrub",
             "SELECT * FROM sqlite_sequence ORDER BY name",
         }) {
      for (const std::vector<std::string>& row : Rows(sql)) absl::StrAppend(&text, absl::StrJoin(row, "|"), "\n");
      text += "--\n";
    }
    return text;
  }

  std::string Verdict() {
    std::string verdict;
    for (const char* sql : {"PRAGMA integrity_check", "PRAGMA foreign_key_check"}) {
      for (const std::vector<std::string>& row : Rows(sql)) absl::StrAppend(&verdict, absl::StrJoin(row, "|"), "\n");
    }
    return verdict;
  }

 private:
  sqlite3* connection_ = nullptr;
};

std::string Everything() { return Reader().Everything(); }

struct Operation {
  std::string name;
  std::function<absl::Status(Store&)> run;
};

absl::Status NoteScrub(Store& store, const std::string& cursor) {
  return store.SetScrub({.start_time = absl::FromUnixMicros(7), .cursor = cursor, .over = false});
}

Recording TinyRecording() {
  return {.camera = {.width = 64, .height = 48, .fx = 50, .fy = 51, .cx = 31.5, .cy = 23.5},
          .depth_scale = 5000,
          .color_frame_count = 9,
          .depth_frame_count = 2,
          .median_depth_m = 1.25};
}

JobPlan TinyPlan(int intervals) {
  JobPlan plan;
  for (int i = 0; i < intervals; ++i) {
    plan.intervals.push_back({.index = i, .first_frame = i, .frame_count = 1});
    plan.frames.push_back({.index = i, .time_ns = i, .stem = absl::StrFormat("%06d", i)});
  }
  plan.files.push_back({.path = "constants.json", .size_bytes = 7, .blocks = "abcd"});
  return plan;
}

// Thinks of operations that suit the records as they are.
class Chance {
 public:
  explicit Chance(uint32_t seed) : random_(seed) {}

  Operation Next() {
    Reader reader;
    std::vector<Operation> choices;
    const std::string name = absl::StrCat("n", ++names_);
    // As a client does that tries again until it is told: the request id makes it one.
    if (names_ % 8 == 1) {
      choices.push_back(
          {"create sequence", [name](Store& store) { return store.CreateSequence(kTenant, name, name).status(); }});
    }
    for (const auto& row : reader.Rows("SELECT id, state FROM sequences")) {
      const std::string& id = row[0];
      if (row[1] == "1") {
        std::vector<UploadFile> files;
        for (int i = 0; i < 3; ++i) {
          files.push_back({.path = absl::StrCat(name, "/", i), .size_bytes = 10 * i, .sha256 = std::string(32, 'h')});
        }
        choices.push_back({"create upload", [=](Store& store) {
                             return store.CreateUpload(kTenant, id, files, int64_t{1} << 40, name).status();
                           }});
        Add(choices, 2, {"commit sequence", [=](Store& store) { return store.CommitSequence(kTenant, id).status(); }});
      }
      if (row[1] == "3") {
        NewJob job = {.display_name = name, .sequence_id = id};
        if (names_ % 2 == 0) {
          job.renders = {{.name = "view", .options = "{}", .reach_frames = 1, .streams = {"view"}, .extension = "png"}};
        }
        Add(choices, 2,
            {"create job", [=](Store& store) { return store.CreateJob(kTenant, job, name, false).status(); }});
      }
      if (names_ % 7 == 0) {
        choices.push_back({"delete sequence", [=](Store& store) { return store.DeleteSequence(kTenant, id); }});
      }
    }
    for (const auto& row : reader.Rows("SELECT u.id, u.size_bytes, u.committed_size, f.path, f.size_bytes FROM uploads "
                                       "u JOIN files f ON f.upload = u.number WHERE finished = 0 AND position = 2")) {
      const std::string& id = row[0];
      const int size = std::stoi(row[1]), committed = std::stoi(row[2]);
      if (committed < size) {
        const int next = std::min(size, committed + 20);
        std::vector<FileChecksum> complete;
        if (next == size) complete.push_back({.path = row[3], .size_bytes = std::stoi(row[4]), .blocks = "wxyz"});
        Add(choices, 3, {"commit bytes", [=](Store& store) { return store.SetCommittedSize(id, next, complete); }});
      } else {
        Add(choices, 3, {"finish upload", [=](Store& store) { return store.FinishUpload(id).status(); }});
      }
    }
    for (const auto& row : reader.Rows("SELECT id, state FROM jobs")) {
      const std::string& id = row[0];
      if (row[1] <= "2") {
        if (names_ % 4 == 0) {
          choices.push_back({"cancel job", [=](Store& store) { return store.CancelJob(kTenant, id).status(); }});
        }
      } else if (row[1] != "3") {
        choices.push_back({"delete job", [=](Store& store) { return store.DeleteJob(kTenant, id); }});
        choices.push_back({"retry job", [=](Store& store) { return store.RetryJob(kTenant, id).status(); }});
      }
    }
    for (const auto& row : reader.Rows("SELECT number, kind, first_interval, interval_count FROM tasks WHERE "
                                       "running = 1")) {
      const int64_t task = std::stoll(row[0]);
      const auto kind = static_cast<TaskKind>(std::stoi(row[1]));
      const int first = std::stoi(row[2]), count = std::stoi(row[3]);
      if (names_ % 5 == 0) {
        choices.push_back({"fail task", [=](Store& store) {
                             return store.FailTask(task, absl::InternalError("crashed"), /*retry=*/true);
                           }});
        choices.push_back({"release task", [=](Store& store) { return store.ReleaseTask(task); }});
      }
      switch (kind) {
        case TaskKind::kValidate:
          Add(choices, 4, {"finish validation", [=](Store& store) {
                             return store.FinishValidation(task, {.recording = TinyRecording()});
                           }});
          break;
        case TaskKind::kPrepare:
          Add(choices, 4, {"finish prepare", [=](Store& store) { return store.FinishPrepare(task, TinyPlan(3)); }});
          break;
        case TaskKind::kIntervals:
        case TaskKind::kRender: {
          const int interval = first + names_ % count;
          Add(choices, 3, {"finish interval", [=](Store& store) {
                             return store
                                 .FinishInterval(task, interval, 0.5,
                                                 {{.path = absl::StrCat("out/", interval, "/", static_cast<int>(kind)),
                                                   .size_bytes = 4,
                                                   .blocks = "1234"}})
                                 .status();
                           }});
          Add(choices, 2, {"complete task", [=](Store& store) { return store.CompleteTask(task); }});
          break;
        }
        case TaskKind::kAssemble:
          Add(choices, 3, {"assemble", [=](Store& store) {
                             return store.CompleteTask(
                                 task, std::vector<int>{0},
                                 {{.path = "out/report.json", .size_bytes = 4, .blocks = "5678"}});
                           }});
          break;
        case TaskKind::kSelfCheck:
          break;
      }
    }
    const bool work = !reader
                           .Rows(
                               "SELECT 1 FROM tasks WHERE running = 0 UNION ALL SELECT 1 FROM ready_parts UNION ALL "
                               "SELECT 1 FROM intervals WHERE done = 0 AND task IS NULL")
                           .empty();
    if (work || choices.empty()) {
      Add(choices, 3, {"claim", [](Store& store) {
                         return store.ClaimTask([](const JobRecord&, TaskKind) { return 2; }).status();
                       }});
    }
    if (names_ % 6 == 0) {
      choices.push_back({"release all", [](Store& store) { return store.ReleaseAllTasks(); }});
      choices.push_back({"note scrub", [name](Store& store) { return NoteScrub(store, name); }});
    }
    return choices[random_() % choices.size()];
  }

 private:
  static void Add(std::vector<Operation>& choices, int weight, const Operation& operation) {
    choices.insert(choices.end(), static_cast<size_t>(weight), operation);
  }

  std::minstd_rand random_;
  int names_ = 0;
};

class StoreFaults : public testing::Test {
 protected:
  StoreFaults() {
    // Whole disks are copied all the time: their memory is kept.
    mallopt(M_TRIM_THRESHOLD, 1 << 30);
    mallopt(M_MMAP_THRESHOLD, 1 << 30);
  }

  // Checkpoints come within a few operations, and not after a thousand pages.
  static absl::StatusOr<std::unique_ptr<Store>> Open() { return OpenSqliteStore(kFile, {}, /*checkpoint_pages=*/12); }

  // Which I/O of so many a fault hits: each, or else the first, the last ones, which commit, and some in between.
  std::vector<int64_t> Points(int64_t operations) {
    std::set<int64_t> points;
    for (int64_t i = 0; i < operations && i < kPoints; ++i) {
      points.insert(operations <= kPoints ? i
                    : i == 0              ? 0
                    : i < 4               ? operations - i
                                          : static_cast<int64_t>(random_() % static_cast<uint64_t>(operations)));
    }
    return {points.begin(), points.end()};
  }

  // A fault is told as what it is.
  static void ExpectClear(const absl::Status& status, FaultKind kind) {
    if (kind == FaultKind::kFull || kind == FaultKind::kShortWrite) {
      EXPECT_THAT(status, HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
    } else {
      EXPECT_THAT(status, HasStatus(absl::StatusCode::kInternal, testing::HasSubstr("database: ")));
    }
  }

  FaultyDisk disk_{/*seed=*/1};
  std::minstd_rand random_{1};
  int faults_ = 0;
};

// After a fault the store is used further, closed and opened again, or opened after a power cut.
enum class Then { kTryAgain, kReopen, kCutPower };

TEST_F(StoreFaults, EveryOperationAtEveryIo) {
  Chance chance(/*seed=*/1);
  ASSERT_THAT(Open(), IsOk());
  FaultyDisk::Image image = disk_.Copy();
  std::map<std::string, int> tried;
  for (int step = 0; step < kOperations; ++step) {
    disk_.PutBack(image);
    auto good = Take(Open());
    const std::string before = Everything();
    const Operation operation = chance.Next();
    const absl::Status verdict = operation.run(*good);
    const std::string after = Everything();
    EXPECT_TRUE(verdict.ok() || before == after) << operation.name << ": " << verdict;
    ++tried[operation.name];
    const FaultyDisk::Image next = disk_.Copy();
    good.reset();

    for (const FaultKind kind : kFaultKinds) {
      disk_.PutBack(image);
      auto counted = Take(Open());
      disk_.Arm(kind, std::numeric_limits<int64_t>::max());
      EXPECT_EQ(operation.run(*counted).code(), verdict.code());
      disk_.Repair();
      counted.reset();
      for (const int64_t n : Points(disk_.operations())) {
        const auto then = static_cast<Then>(random_() % 3);
        SCOPED_TRACE(absl::StrFormat("step %d, %s, %s at I/O %d (lasting: %d), then %d", step, operation.name,
                                     std::string(ToString(kind)), n, n % 2, static_cast<int>(then)));
        disk_.PutBack(image);
        auto store = Take(Open());
        disk_.Arm(kind, n, /*lasts=*/n % 2 == 1);
        const absl::Status status = operation.run(*store);
        if (!disk_.struck()) {  // times have other digits now and then, and take another page
          disk_.Repair();
          continue;
        }
        ++faults_;
        const bool done = status.code() == verdict.code();  // a fault may hit what is not needed, such as a checkpoint
        if (!done) ExpectClear(status, kind);
        if (kind != FaultKind::kPowerCut) {
          disk_.Repair();
          EXPECT_EQ(Everything(), done ? after : before) << "what a running server tells";
          if (then == Then::kTryAgain && !done) {
            EXPECT_EQ(operation.run(*store).code(), verdict.code());
            EXPECT_EQ(Everything(), after);
          }
        }
        if (kind == FaultKind::kPowerCut || then != Then::kReopen) disk_.CutPower();
        store.reset();
        store = Take(Open());
        const std::string left = Everything();
        if (done || (kind != FaultKind::kPowerCut && then == Then::kTryAgain)) {
          EXPECT_EQ(left, after) << "it was acknowledged";
        } else {
          EXPECT_TRUE(left == before || left == after) << left << "\nwas before\n" << before << "\nafter\n" << after;
          if (left == before) {
            EXPECT_EQ(operation.run(*store).code(), verdict.code());
            EXPECT_EQ(Everything(), after);
          }
        }
        EXPECT_EQ(Reader().Verdict(), "ok\n");
        store.reset();
        if (HasFailure()) return;
      }
    }
    image = next;
  }
  for (const auto& [name, count] : tried) std::cout << count << " x " << name << "\n";
  std::cout << faults_ << " faults\n";
  RecordProperty("faults", faults_);
}

// A first start, and a start after a kill, at every I/O of them: what failed is told, and the next start finds what was
// there.
TEST_F(StoreFaults, StartsAtEveryIo) {
  Chance chance(/*seed=*/2);
  FaultyDisk::Image image = disk_.Copy();
  for (int step = 0; step < 10; ++step) {
    disk_.PutBack(image);
    auto good = Take(Open());
    const std::string before = Everything();
    for (const FaultKind kind : kFaultKinds) {
      disk_.PutBack(image);
      disk_.Arm(kind, std::numeric_limits<int64_t>::max());
      auto counted = Take(Open());
      disk_.Repair();
      counted.reset();
      for (const int64_t n : Points(disk_.operations())) {
        SCOPED_TRACE(absl::StrFormat("step %d, %s at I/O %d", step, std::string(ToString(kind)), n));
        disk_.PutBack(image);
        disk_.Arm(kind, n, /*lasts=*/n % 2 == 1);
        auto store = Open();
        EXPECT_TRUE(disk_.struck());
        disk_.Repair();
        ++faults_;
        if (!store.ok()) ExpectClear(store.status(), kind);
        if (kind == FaultKind::kPowerCut || n % 3 != 0) disk_.CutPower();
        store = absl::UnknownError("closed");
        const auto again = Take(Open());
        EXPECT_EQ(Everything(), before);
        EXPECT_EQ(Reader().Verdict(), "ok\n");
        EXPECT_THAT(again->CreateSequence(kTenant, "next", "next"), IsOk());
        if (HasFailure()) return;
      }
    }
    // On to what the next start finds: some operations, and a kill.
    disk_.PutBack(image);
    good = Take(Open());
    for (int i = 0; i < 8; ++i) chance.Next().run(*good).IgnoreError();
    image = disk_.Copy();
  }
  std::cout << faults_ << " faults\n";
}

// One bit is wrong, anywhere in the file or its log. Not every such bit is seen (SQLite has checksums for its log
// alone), but what is seen is told as damage, nothing crashes, and nothing is taken for somebody's fault or a bug.
TEST_F(StoreFaults, FlippedBits) {
  Chance chance(/*seed=*/3);
  auto good = Take(Open());
  for (int i = 0; i < 60; ++i) chance.Next().run(*good).IgnoreError();
  const FaultyDisk::Image image = disk_.Copy();
  good.reset();
  int told = 0;
  for (int flip = 0; flip < kFlips; ++flip) {
    SCOPED_TRACE(absl::StrFormat("flip %d", flip));
    disk_.PutBack(image);
    ASSERT_TRUE(disk_.FlipBit(flip % 4 == 0 ? absl::StrCat(kFile, "-wal") : kFile));
    std::vector<absl::Status> said;
    if (auto store = Open(); store.ok()) {
      const auto jobs = (*store)->ListJobs(kTenant, {}, {});
      said = {(*store)->ListSequences(kTenant, {}, {}).status(), jobs.status(), (*store)->ReleaseAllTasks(),
              (*store)->StoredFiles({}).status()};
      for (size_t i = 0; jobs.ok() && i < jobs->items.size(); ++i) {
        const std::string& id = jobs->items[i].id;
        said.push_back((*store)->JobFrames(kTenant, id, 0, 100).status());
        said.push_back((*store)->RetryJob(kTenant, id).status());
      }
      for (int i = 0; i < 5; ++i) {
        said.push_back((*store)->ClaimTask([](const JobRecord&, TaskKind) { return 2; }).status());
      }
      said.push_back((*store)->CreateSequence(kTenant, "next", "next").status());
    } else {
      said = {store.status()};
    }
    bool tells = false;
    for (const absl::Status& status : said) {
      tells = tells || absl::IsDataLoss(status);
      // NOT_FOUND: the index no longer leads to the row.
      if (status.ok() || absl::IsDataLoss(status) || absl::IsFailedPrecondition(status) || absl::IsNotFound(status)) {
        continue;
      }
      ADD_FAILURE() << status;
    }
    told += tells ? 1 : 0;
  }
  std::cout << told << " of " << kFlips << " flipped bits were told\n";
  EXPECT_GT(told, 0);
}

}  // namespace
}  // namespace depthtween::server
