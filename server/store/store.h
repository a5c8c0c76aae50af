// The server's records of sequences, uploads, jobs and tasks: what must survive kill -9.
//
// Every method is one transaction: when it returns OK the change is durable, otherwise nothing has changed. Methods
// that a client's call can reach take the tenant that it is of, and see nothing of others. Errors everywhere: NotFound
// for an unknown id; ResourceExhausted (DISK_FULL) when the disk is full, (SERVER_BUSY) when another process holds the
// database for seconds; Internal for a fault of the database. Reasons are those of error_info.h. Threads: all methods
// may be called concurrently.
#ifndef DEPTHTWEEN_SERVER_STORE_STORE_H_
#define DEPTHTWEEN_SERVER_STORE_STORE_H_

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "server/store/limits.h"
#include "server/store/records.h"
#include "server/store/tenant.h"

namespace depthtween::server {

// One page of a list. `token` is a next_token of the same list with the same filter, or empty for the first page.
struct PageRequest {
  int size = 50;
  std::string token;
};
template <typename T>
struct Page {
  std::vector<T> items;
  std::string next_token;  // empty on the last page
};

struct SequenceFilter {
  std::optional<SequenceState> state;
};
struct JobFilter {
  std::optional<JobState> state;
  std::optional<std::string> sequence_id;
};

// How many intervals a worker takes at once, given the job it takes them from, to compute (kIntervals) or to render
// (kRender).
using BatchSize = std::function<int(const JobRecord& job, TaskKind kind)>;

// What ClaimTask does about validations: they go before jobs, they are taken when no job has work, or not at all.
enum class ClaimValidations { kFirst, kLast, kNone };

class Store {
 public:
  virtual ~Store() = default;

  // The id of the data folder that these records are of; nullopt in a new store.
  virtual absl::StatusOr<std::optional<std::string>> FolderId() = 0;
  virtual absl::Status SetFolderId(std::string_view id) = 0;

  // What the store refuses to go beyond.
  virtual LiveLimits& limits() = 0;
  // Whether records can be read and written now: a write that changes nothing. Errors as everywhere, and DataLoss once
  // any call has met damage in the database.
  virtual absl::Status Probe() = 0;

  // ---- sequences ----
  // `request_id` may be empty. The same id with the same arguments returns what the first call made; with other
  // arguments AlreadyExists (IDEMPOTENCY_MISMATCH). The id is forgotten when what it made is deleted. CreateUpload and
  // CreateJob do the same.
  virtual absl::StatusOr<SequenceRecord> CreateSequence(const Tenant& tenant, std::string_view display_name,
                                                        std::string_view request_id) = 0;
  virtual absl::StatusOr<SequenceRecord> GetSequence(const Tenant& tenant, std::string_view id) = 0;
  // Newest first. InvalidArgument for a token that is not of this list and filter.
  virtual absl::StatusOr<Page<SequenceRecord>> ListSequences(const Tenant& tenant, const SequenceFilter& filter,
                                                             const PageRequest& page) = 0;
  // Also while it is being validated: the task is gone with it. FailedPrecondition while a job that has not ended uses
  // it.
  virtual absl::Status DeleteSequence(const Tenant& tenant, std::string_view id) = 0;

  // ---- uploads ----
  // Checks paths, sizes and limits, and that `room_bytes`, the room on the disk, has space for this upload beside what
  // unfinished ones have announced and not sent yet. InvalidArgument names the file; AlreadyExists (DUPLICATE_PATH) if
  // the sequence has it; ResourceExhausted (LIMIT_EXCEEDED); FailedPrecondition unless kUploading.
  virtual absl::StatusOr<UploadRecord> CreateUpload(const Tenant& tenant, std::string_view sequence_id,
                                                    const std::vector<UploadFile>& files, int64_t room_bytes,
                                                    std::string_view request_id, std::string_view metadata = {}) = 0;
  virtual absl::StatusOr<UploadRecord> GetUpload(const Tenant& tenant, std::string_view sequence_id,
                                                 std::string_view upload_id) = 0;
  // The manifest, in order.
  virtual absl::StatusOr<std::vector<UploadFile>> UploadFiles(std::string_view upload_id) = 0;
  // Moves committed_size, and keeps the checksums of the files that are complete with it. FailedPrecondition if the
  // upload is finished or its sequence is no longer kUploading.
  virtual absl::Status SetCommittedSize(std::string_view upload_id, int64_t committed_size,
                                        const std::vector<FileChecksum>& complete = {}) = 0;
  // FailedPrecondition unless every byte is committed. Repeating it changes nothing.
  virtual absl::StatusOr<UploadRecord> FinishUpload(std::string_view upload_id) = 0;
  // Grammar of giving one up:  RewindUpload, its files are removed, DeleteUpload. Whenever that is cut off, the upload
  // can be written from its beginning, or given up again. Both: FailedPrecondition if it is finished. No byte of it is
  // committed any more, and no file has a checksum.
  virtual absl::Status RewindUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id) = 0;
  // Its files are no longer part of the sequence.
  virtual absl::Status DeleteUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id) = 0;

  // kUploading -> kValidating, with a validate task. FailedPrecondition if an upload is unfinished or there is none.
  // Repeating it changes nothing.
  virtual absl::StatusOr<SequenceRecord> CommitSequence(const Tenant& tenant, std::string_view id) = 0;

  // Of a sequence that is, or was, one file NAME.zip and nothing else; nullopt of all others.
  virtual absl::StatusOr<std::optional<SequenceArchive>> GetArchive(std::string_view sequence_id) = 0;

  // Of those that are kUploading and not pinned, the ones of which no byte has come since `before`.
  virtual absl::StatusOr<std::vector<Collectable>> AbandonedSequences(absl::Time before) = 0;
  // Deletes one of them. FailedPrecondition if bytes have come meanwhile.
  virtual absl::Status DeleteAbandonedSequence(const Collectable& sequence) = 0;

  // ---- jobs ----
  // FailedPrecondition unless the sequence is kReady, or when job.depth_from has no depth to give; InvalidArgument when
  // that is another depth; ResourceExhausted (LIMIT_EXCEEDED) when the queue is full. The self-check of depth_from, if
  // there is one, counts for this job too when it asks for one.
  // With `validate_only` nothing is made and the record has no id.
  virtual absl::StatusOr<JobRecord> CreateJob(const Tenant& tenant, const NewJob& job, std::string_view request_id,
                                              bool validate_only) = 0;
  virtual absl::StatusOr<JobRecord> GetJob(const Tenant& tenant, std::string_view id) = 0;
  // Newest first. InvalidArgument for a token that is not of this list and filter.
  virtual absl::StatusOr<Page<JobRecord>> ListJobs(const Tenant& tenant, const JobFilter& filter,
                                                   const PageRequest& page, JobDetail detail = JobDetail::kFull) = 0;
  // How many jobs there are of every tenant in every state; none of 0.
  struct JobCount {
    std::string tenant;
    JobState state;
    int count;
  };
  virtual absl::StatusOr<std::vector<JobCount>> CountJobs() = 0;
  // JobRecord::queue_position of every queued job, by id.
  virtual absl::StatusOr<std::map<std::string, int, std::less<>>> QueuePositions() = 0;
  // FailedPrecondition unless it has ended.
  virtual absl::Status DeleteJob(const Tenant& tenant, std::string_view id) = 0;
  // kQueued -> kCancelled, kRunning -> kCancelling (kCancelled when no task of it is running). No task of it starts any
  // more. Repeating it changes nothing; FailedPrecondition if it ended otherwise.
  virtual absl::StatusOr<JobRecord> CancelJob(const Tenant& tenant, std::string_view id) = 0;
  // kFailed | kCancelled -> kQueued, keeping finished intervals and the self-check. FailedPrecondition otherwise, or if
  // the sequence is gone.
  virtual absl::StatusOr<JobRecord> RetryJob(const Tenant& tenant, std::string_view id) = 0;
  // Intervals [first, first + count) of its plan; none before `prepare`.
  virtual absl::StatusOr<std::vector<PlannedInterval>> JobIntervals(std::string_view id, int first, int count) = 0;
  // Frames [first, first + count) that the job will have; fewer at its end, none before `prepare`. They are ready as
  // depth is, or with `render` >= 0 as the pictures of that one of JobRecord::renders are.
  virtual absl::StatusOr<std::vector<FrameRecord>> JobFrames(const Tenant& tenant, std::string_view id, int first,
                                                             int count, int render = -1) = 0;

  // ---- time limits and retention ----
  // Fails the jobs that are kQueued or kRunning beyond their own limit or the server's, whichever is shorter, with
  // DeadlineExceeded (TIME_LIMIT). Their tasks lose their claims. Returns the jobs.
  virtual absl::StatusOr<std::vector<std::string>> FailOverdueJobs(const TimeLimits& server) = 0;
  virtual absl::StatusOr<JobRecord> PinJob(const Tenant& tenant, std::string_view id, bool pinned) = 0;
  virtual absl::StatusOr<SequenceRecord> PinSequence(const Tenant& tenant, std::string_view id, bool pinned) = 0;
  // What may be collected, of all tenants, in the order of `since`: it is not pinned, and has ended or is not used.
  virtual absl::StatusOr<std::vector<Collectable>> CollectableJobs() = 0;
  virtual absl::StatusOr<std::vector<Collectable>> CollectableSequences() = 0;
  // The bytes of the files of one of them.
  virtual absl::StatusOr<int64_t> BytesOfJob(std::string_view id) = 0;
  virtual absl::StatusOr<int64_t> BytesOfSequence(std::string_view id) = 0;
  // Deletes one of them. FailedPrecondition if it has been pinned or used since it was listed.
  virtual absl::Status CollectJob(const Collectable& job) = 0;
  virtual absl::Status CollectSequence(const Collectable& sequence) = 0;

  // ---- work ----
  // Grammar for one task:  ClaimTask (FinishUnpacking? FinishValidation | FinishSelfCheck | FinishPrepare | FailTask |
  // ReleaseTask)
  //                     |  ClaimTask FinishInterval* (CompleteTask | FailTask | ReleaseTask)
  // All but ClaimTask take the task's number and return FailedPrecondition, changing nothing, when that attempt is no
  // longer the one that counts: its job failed, or it was released.

  // The next piece of work, now running; nullopt when there is none. Tenants take turns: the one with fewest tasks at
  // work goes first, then the one that has waited longest; none gets more than Limits::max_tenant_tasks. Among the jobs
  // of a tenant the higher priority goes first, then the older. Validations of the tenant that has fewest running go
  // first unless `validations` says otherwise, then jobs in their order. Batches of intervals are cut here: contiguous,
  // unfinished, unclaimed. Intervals are rendered once the frames they look at are finished, and before further ones
  // are computed, so that pictures stream as depth does.
  virtual absl::StatusOr<std::optional<Task>> ClaimTask(const BatchSize& batch_size,
                                                        ClaimValidations validations = ClaimValidations::kFirst) = 0;
  // For a validate task: what the archive of its sequence held takes the archive's place. ResourceExhausted
  // (LIMIT_EXCEEDED). The task goes on.
  virtual absl::Status FinishUnpacking(int64_t task, const SequenceArchive& archive,
                                       const std::vector<FileChecksum>& files) = 0;
  // The state of a validation: sequence kValidating -> kReady | kInvalid. Ends the task.
  virtual absl::Status FinishValidation(int64_t task, const ValidationResult& result) = 0;
  // What a self-check task measured. Ends the task and creates the job's prepare task.
  virtual absl::Status FinishSelfCheck(int64_t task, const SelfCheck& check) = 0;
  // What a prepare task found. Ends the task. A plan without intervals is InvalidArgument.
  virtual absl::Status FinishPrepare(int64_t task, const JobPlan& plan) = 0;
  // An interval of an intervals or a render task is done: its files are durable, and these are their checksums. Returns
  // the job. Repeating it changes nothing.
  virtual absl::StatusOr<JobRecord> FinishInterval(int64_t task, int interval, double seconds,
                                                   const std::vector<FileChecksum>& files = {}) = 0;
  // Ends an intervals, render or assemble task whose child ended well. Intervals it left undone go back. When the last
  // interval of a job is computed and rendered, creates the assemble task; when that one ends, the job has kSucceeded.
  // `assembled` are the frames that an assemble task has made a file for, if it makes any: FrameRecord::assembled.
  // `files` are what it left in the job's folder.
  virtual absl::Status CompleteTask(int64_t task, const std::optional<std::vector<int>>& assembled = std::nullopt,
                                    const std::vector<FileChecksum>& files = {}) = 0;
  // Ends an attempt that went wrong. With `retry` and fewer than `kMaxAttempts` failures the work goes back to be
  // claimed anew; otherwise the job is kFailed (the sequence kInvalid) with `error`, and its other tasks lose their
  // claims.
  virtual absl::Status FailTask(int64_t task, const absl::Status& error, bool retry) = 0;
  // Gives work back without blame: the server stops, or the job is cancelled (kCancelling -> kCancelled with the last).
  virtual absl::Status ReleaseTask(int64_t task) = 0;
  // After a restart: releases every task that was running.
  virtual absl::Status ReleaseAllTasks() = 0;

  // ---- webhooks ----
  // Those to be sent by now, the longest due first.
  virtual absl::StatusOr<std::vector<DueWebhook>> DueWebhooks(absl::Time now, int count) = 0;
  // How an attempt to send one went: all but the url of `now` is taken. NotFound when it is not to be sent (any more):
  // its job was deleted, or queued again.
  virtual absl::Status RecordWebhook(std::string_view event_id, const WebhookRecord& now) = 0;

  // ---- files ----
  // The checksum of one file of a job; nullopt if none is recorded.
  virtual absl::StatusOr<std::optional<FileChecksum>> JobFile(std::string_view job_id, std::string_view path) = 0;
  // Of all files of a job or a sequence that have one, by path. None if there is no such job or sequence.
  virtual absl::StatusOr<std::vector<FileChecksum>> JobFiles(std::string_view job_id) = 0;
  virtual absl::StatusOr<std::vector<FileChecksum>> SequenceFiles(std::string_view sequence_id) = 0;
  // All files that are stored, page by page in an order that does not change; `page.token` is a next_token. Files that
  // come or go meanwhile are listed or not.
  virtual absl::StatusOr<Page<StoredFile>> StoredFiles(const PageRequest& page) = 0;
  // The bytes of all of them.
  virtual absl::StatusOr<int64_t> StoredBytes() = 0;
  virtual absl::StatusOr<ScrubRecord> GetScrub() = 0;
  virtual absl::Status SetScrub(const ScrubRecord& scrub) = 0;
};

// Attempts at one piece of work before its job fails.
inline constexpr int kMaxAttempts = 3;

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_STORE_H_
