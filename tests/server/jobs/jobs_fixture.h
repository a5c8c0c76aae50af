// A server without network: stores, sequences and jobs on a folder that vanishes, with fake_core as its child.
#ifndef DEPTHTWEEN_TESTS_SERVER_JOBS_JOBS_FIXTURE_H_
#define DEPTHTWEEN_TESTS_SERVER_JOBS_JOBS_FIXTURE_H_

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "proto/depthtween/crc32c.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/sequences.h"
#include "server/store/folder_blob_store.h"
#include "server/store/sqlite.h"
#include "server/store/sqlite_store.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {

// Returns once it is so. There is no deadline of its own: the time-out of the test program is the limit, so that a busy
// machine makes no test fail.
inline void WaitUntil(const std::function<bool()>& so) {
  while (!so()) usleep(2000);
}

// False for a process that has ended, even if nobody has reaped it yet.
inline bool IsAlive(int pid) {
  const std::string stat = ReadText("/proc/" + std::to_string(pid) + "/stat");
  const size_t name_end = stat.rfind(") ");
  return name_end != std::string::npos && stat[name_end + 2] != 'Z' && stat[name_end + 2] != 'X';
}

class JobsFixture : public testing::Test {
 protected:
  explicit JobsFixture(const Limits& limits = {}) : limits_(limits) { limits_.reserved_disk_bytes = 0; }
  ~JobsFixture() override { Close(); }

  // Everything of a server but its jobs; with them after StartJobs.
  void OpenStores(const std::string& folder) {
    directory_ = Take(DataDirectory::Open(folder));
    store_ = Take(OpenSqliteStore(directory_->DatabaseFile(), limits_));
    blobs_ = MakeFolderBlobStore(*directory_);
    sequences_ = std::make_unique<Sequences>(
        *store_, *blobs_,
        [this] {
          if (jobs_) jobs_->Wake();
        },
        [this](std::string_view id) {
          if (jobs_) jobs_->StopValidation(id);
        });
  }
  // Attempts follow one another at once unless not `hasty`.
  void StartJobs(int workers = 1, JobManagerOptions options = {}, bool hasty = true) {
    options.core_program = FAKE_CORE;
    options.workers = workers;
    if (hasty) options.retry_backoff = absl::Milliseconds(20);
    jobs_ = Take(JobManager::Start(*directory_, *store_, options));
  }
  void Start(int workers = 1, const JobManagerOptions& options = {}) {
    OpenStores(folder_ / "data");
    StartJobs(workers, options);
  }
  void Close() {
    jobs_.reset();
    sequences_.reset();
    blobs_.reset();
    store_.reset();
    directory_.reset();
  }

  // Uploads a sequence that makes fake_core behave as the script says, and commits it.
  std::string CommittedSequence(const std::string& script) {
    const std::string id = Take(sequences_->Create(kTenant, "", "")).id;
    const UploadRecord upload = Take(sequences_->StartUpload(
        kTenant, id, {{.path = "script", .size_bytes = static_cast<int64_t>(script.size())}}, ""));
    const auto writer = Take(sequences_->OpenUpload(kTenant, id, upload.id));
    EXPECT_THAT(writer->Write(0, script, Crc32c(script)), IsOk());
    EXPECT_THAT(writer->Finish(), IsOk());
    EXPECT_THAT(sequences_->Commit(kTenant, id), IsOk());
    return id;
  }
  SequenceRecord Validated(const std::string& id) {
    WaitUntil([&] { return Take(sequences_->Get(kTenant, id)).state != SequenceState::kValidating; });
    return Take(sequences_->Get(kTenant, id));
  }
  std::string ReadySequence(const std::string& script = "") {
    const std::string id = CommittedSequence(script);
    EXPECT_EQ(Validated(id).state, SequenceState::kReady);
    return id;
  }
  std::string NewJobOn(const std::string& sequence) {
    return Take(jobs_->Create(kTenant, {.sequence_id = sequence}, "", false)).record.id;
  }
  JobView View(const std::string& job) { return Take(jobs_->Get(kTenant, job)); }
  JobState State(const std::string& job) { return View(job).record.state; }
  JobView Ended(const std::string& job) {
    WaitUntil([&] { return HasEnded(State(job)); });
    return View(job);
  }

  // What fake_core wrote to its log: the numbers after one word, such as "interval" or "start".
  std::vector<int> Logged(const std::string& sequence, const std::string& word) {
    std::vector<int> numbers;
    std::istringstream log(ReadText(directory_->SequenceFolder(sequence) + "/log"));
    std::string first;
    for (int number = 0; log >> first >> number;) {
      if (first == word) numbers.push_back(number);
    }
    return numbers;
  }
  std::vector<int> SortedIntervals(const std::string& sequence) {
    std::vector<int> intervals = Logged(sequence, "interval");
    std::sort(intervals.begin(), intervals.end());
    return intervals;
  }
  // Has the store forget the checksums of the job's files, as if an older version had made them: the test puts others
  // in their place.
  void ForgetChecksums(const std::string& job) {
    EXPECT_THAT(Take(Database::Open(directory_->DatabaseFile()))
                    ->Run("DELETE FROM job_files WHERE job = (SELECT number FROM jobs WHERE id = ?)", {job}),
                IsOk());
  }
  // Lets fake_core go on where its script says wait_at.
  void Go(const std::string& sequence) { WriteText(directory_->SequenceFolder(sequence) + "/go", ""); }
  // An output by its id: "depth", or the name of a render.
  OutputSpec Output(const std::string& job, const std::string& id) {
    const std::vector<OutputSpec> outputs = OutputsOf(View(job).record);
    const auto found = std::find_if(outputs.begin(), outputs.end(), [&](const OutputSpec& o) { return o.id == id; });
    EXPECT_NE(found, outputs.end()) << id;
    return found == outputs.end() ? outputs.front() : *found;
  }
  std::string Frame(const std::string& job, const std::string& output, const std::string& stem) {
    return ReadText(jobs_->FrameFile(job, Output(job, output), stem));
  }

  TemporaryFolder folder_;
  Limits limits_;
  std::unique_ptr<DataDirectory> directory_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<BlobStore> blobs_;
  std::unique_ptr<Sequences> sequences_;
  std::unique_ptr<JobManager> jobs_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_JOBS_JOBS_FIXTURE_H_
