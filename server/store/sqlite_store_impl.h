// The class behind OpenSqliteStore; its methods are spread over
// sqlite_{sequences,jobs,work,files,retention,webhooks}.cc.
#ifndef DEPTHTWEEN_SERVER_STORE_SQLITE_STORE_IMPL_H_
#define DEPTHTWEEN_SERVER_STORE_SQLITE_STORE_IMPL_H_

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/store/limits.h"
#include "server/store/sqlite.h"
#include "server/store/store.h"
#include "server/telemetry/metrics.h"

namespace depthtween::server {

class SqliteStore : public Store {
 public:
  SqliteStore(std::unique_ptr<Database> database, const Limits& limits)
      : database_(std::move(database)), limits_(limits) {}

  absl::StatusOr<std::optional<std::string>> FolderId() override;
  absl::Status SetFolderId(std::string_view id) override;
  LiveLimits& limits() override { return limits_; }
  absl::Status Probe() override;

  absl::StatusOr<SequenceRecord> CreateSequence(const Tenant& tenant, std::string_view display_name,
                                                std::string_view request_id) override;
  absl::StatusOr<SequenceRecord> GetSequence(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<Page<SequenceRecord>> ListSequences(const Tenant& tenant, const SequenceFilter& filter,
                                                     const PageRequest& page) override;
  absl::Status DeleteSequence(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<UploadRecord> CreateUpload(const Tenant& tenant, std::string_view sequence_id,
                                            const std::vector<UploadFile>& files, int64_t room_bytes,
                                            std::string_view request_id, std::string_view metadata) override;
  absl::StatusOr<UploadRecord> GetUpload(const Tenant& tenant, std::string_view sequence_id,
                                         std::string_view upload_id) override;
  absl::StatusOr<std::vector<UploadFile>> UploadFiles(std::string_view upload_id) override;
  absl::Status SetCommittedSize(std::string_view upload_id, int64_t committed_size,
                                const std::vector<FileChecksum>& complete) override;
  absl::StatusOr<UploadRecord> FinishUpload(std::string_view upload_id) override;
  absl::Status RewindUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id) override;
  absl::Status DeleteUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id) override;
  absl::StatusOr<std::optional<SequenceArchive>> GetArchive(std::string_view sequence_id) override;
  absl::Status FinishUnpacking(int64_t task, const SequenceArchive& archive,
                               const std::vector<FileChecksum>& files) override;
  absl::StatusOr<std::vector<Collectable>> AbandonedSequences(absl::Time before) override;
  absl::Status DeleteAbandonedSequence(const Collectable& sequence) override;
  absl::StatusOr<SequenceRecord> CommitSequence(const Tenant& tenant, std::string_view id) override;

  absl::StatusOr<JobRecord> CreateJob(const Tenant& tenant, const NewJob& job, std::string_view request_id,
                                      bool validate_only) override;
  absl::StatusOr<JobRecord> GetJob(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<Page<JobRecord>> ListJobs(const Tenant& tenant, const JobFilter& filter, const PageRequest& page,
                                           JobDetail detail) override;
  absl::StatusOr<std::vector<JobCount>> CountJobs() override;
  absl::StatusOr<std::map<std::string, int, std::less<>>> QueuePositions() override;
  absl::Status DeleteJob(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<JobRecord> CancelJob(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<JobRecord> RetryJob(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<std::vector<PlannedInterval>> JobIntervals(std::string_view id, int first, int count) override;
  absl::StatusOr<std::vector<FrameRecord>> JobFrames(const Tenant& tenant, std::string_view id, int first, int count,
                                                     int render) override;

  absl::StatusOr<std::vector<std::string>> FailOverdueJobs(const TimeLimits& server) override;
  absl::StatusOr<JobRecord> PinJob(const Tenant& tenant, std::string_view id, bool pinned) override;
  absl::StatusOr<SequenceRecord> PinSequence(const Tenant& tenant, std::string_view id, bool pinned) override;
  absl::StatusOr<std::vector<Collectable>> CollectableJobs() override;
  absl::StatusOr<std::vector<Collectable>> CollectableSequences() override;
  absl::StatusOr<int64_t> BytesOfJob(std::string_view id) override;
  absl::StatusOr<int64_t> BytesOfSequence(std::string_view id) override;
  absl::Status CollectJob(const Collectable& job) override;
  absl::Status CollectSequence(const Collectable& sequence) override;

  absl::StatusOr<std::optional<Task>> ClaimTask(const BatchSize& batch_size, ClaimValidations validations) override;
  absl::Status FinishValidation(int64_t task, const ValidationResult& result) override;
  absl::Status FinishSelfCheck(int64_t task, const SelfCheck& check) override;
  absl::Status FinishPrepare(int64_t task, const JobPlan& plan) override;
  absl::StatusOr<JobRecord> FinishInterval(int64_t task, int interval, double seconds,
                                           const std::vector<FileChecksum>& files) override;
  absl::Status CompleteTask(int64_t task, const std::optional<std::vector<int>>& assembled,
                            const std::vector<FileChecksum>& files) override;
  absl::Status FailTask(int64_t task, const absl::Status& error, bool retry) override;
  absl::Status ReleaseTask(int64_t task) override;
  absl::Status ReleaseAllTasks() override;

  absl::StatusOr<std::vector<DueWebhook>> DueWebhooks(absl::Time now, int count) override;
  absl::Status RecordWebhook(std::string_view event_id, const WebhookRecord& now) override;

  absl::StatusOr<std::optional<FileChecksum>> JobFile(std::string_view job_id, std::string_view path) override;
  absl::StatusOr<std::vector<FileChecksum>> JobFiles(std::string_view job_id) override;
  absl::StatusOr<std::vector<FileChecksum>> SequenceFiles(std::string_view sequence_id) override;
  absl::StatusOr<Page<StoredFile>> StoredFiles(const PageRequest& page) override;
  absl::StatusOr<int64_t> StoredBytes() override;
  absl::StatusOr<ScrubRecord> GetScrub() override;
  absl::Status SetScrub(const ScrubRecord& scrub) override;

 private:
  // A task as its row holds it.
  struct TaskRow {
    int64_t number = 0;
    TaskKind kind = TaskKind::kValidate;
    int64_t sequence = 0;  // 0: none
    int64_t job = 0;       // 0: none
    int failures = 0;
    int first_interval = 0;
    int interval_count = 0;
    int render = 0;
  };

  // One transaction under the mutex.
  template <typename Body>
  auto Transact(const Body& body) {
    const absl::Time start = absl::Now();
    const auto measure = absl::MakeCleanup([start] { ObserveStoreWrite(absl::ToDoubleSeconds(absl::Now() - start)); });
    const std::lock_guard lock(mutex_);
    return database_->Transact(body);
  }

  template <typename Body>
  auto Read(const Body& body) {
    const std::lock_guard lock(mutex_);
    return database_->Read(body);
  }

  // Everything below runs inside a transaction.

  // The id of what `request_id` made in `scope`; nullopt when it is new or empty. AlreadyExists (IDEMPOTENCY_MISMATCH).
  absl::StatusOr<std::optional<std::string>> MadeBefore(const std::string& scope, std::string_view request_id,
                                                        const std::string& fingerprint);
  absl::Status RememberRequest(const std::string& scope, std::string_view request_id, const std::string& fingerprint,
                               const std::string& made_id);

  absl::StatusOr<int64_t> SequenceNumber(const Tenant& tenant, std::string_view id);
  absl::StatusOr<SequenceRecord> ReadSequence(const Tenant& tenant, std::string_view id);
  absl::Status RemoveSequence(std::string_view id);
  absl::Status RemoveJob(std::string_view id);
  absl::Status TouchSequence(int64_t number, SequenceState state);
  absl::StatusOr<UploadRecord> ReadUpload(const Tenant& tenant, std::string_view id);
  absl::StatusOr<UploadRecord> ReadUploadOf(const Tenant& tenant, std::string_view sequence_id,
                                            std::string_view upload_id);
  absl::StatusOr<UploadRecord> UnfinishedUpload(const Tenant& tenant, std::string_view sequence_id,
                                                std::string_view upload_id);
  // Whether the recordings of the tenant may grow by so much.
  absl::Status CheckTenantBytes(const std::string& tenant, int64_t more_bytes);
  absl::Status CheckNewFiles(int64_t sequence, const std::vector<UploadFile>& files);

  absl::StatusOr<int64_t> JobNumber(const Tenant& tenant, std::string_view id);
  absl::StatusOr<JobRecord> ReadJob(int64_t number);
  absl::Status ReadRenders(JobRecord& job, JobDetail detail = JobDetail::kFull);
  absl::Status ReadWebhook(JobRecord& job);
  // The job has ended, which is to be told now; it has been queued again, and its next end is to be told.
  absl::Status TellOfEnd(int64_t job);
  absl::Status TellOfNextEnd(int64_t job);
  // The job that job.depth_from names. FailedPrecondition or InvalidArgument unless it can give what `job` asks for.
  absl::StatusOr<JobRecord> FindDepthFrom(const Tenant& tenant, const NewJob& job);
  absl::Status EndJob(int64_t number, JobState state, const absl::Status& error);

  absl::Status AddTask(TaskKind kind, int64_t owner, int failures);
  // What a job without a plan does first.
  absl::Status AddFirstTask(const JobRecord& job);
  // 0: no job has anything to do now, or none of a tenant that may have another task.
  absl::StatusOr<int64_t> JobWhoseTurnItIs();
  // The task to run for a job that has something to do; its row is made if it is a batch of intervals.
  absl::StatusOr<int64_t> TakeWork(int64_t job, const BatchSize& batch_size);
  // Makes a task of up to `wanted` contiguous intervals, from the first open one on, and claims them. Returns its
  // number.
  absl::StatusOr<int64_t> TakeIntervals(int64_t job, int wanted);
  absl::StatusOr<int64_t> TakeRenderParts(int64_t job, int wanted);
  // FailedPrecondition unless the task is running.
  absl::StatusOr<TaskRow> RunningTask(int64_t number);
  // Removes a task's row; the intervals it leaves undone may be claimed again.
  absl::Status RemoveTask(int64_t number);
  // After a task of the job ended: what comes next.
  absl::Status SettleJob(int64_t job);
  absl::Status Release(const TaskRow& task);
  absl::Status KeepJobFiles(int64_t job, const std::vector<FileChecksum>& files);
  absl::Status Fail(const TaskRow& task, const absl::Status& error, bool retry);
  // Ends a job as kFailed; its tasks lose their claims.
  absl::Status FailJob(int64_t job, const absl::Status& error);
  // As QueuePositions, of one tenant.
  absl::StatusOr<std::map<std::string, int, std::less<>>> ReadQueuePositions(const Tenant& tenant);

  std::mutex mutex_;
  const std::unique_ptr<Database> database_;  // guarded by mutex_
  LiveLimits limits_;
};

// Page tokens name the last number seen, and the list and filter they belong to.
std::string MakePageToken(int64_t last_number, std::string_view list_and_filter);
// The number that the page comes before; the largest there is for an empty token. InvalidArgument for a foreign one.
absl::StatusOr<int64_t> ParsePageToken(const PageRequest& page, std::string_view list_and_filter);
// InvalidArgument if the size is negative or above the limit.
absl::StatusOr<int> CheckPageSize(const PageRequest& page, const Limits& limits);
absl::Status CheckText(std::string_view field, std::string_view text, int max_bytes);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_SQLITE_STORE_IMPL_H_
