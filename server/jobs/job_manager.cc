#include "server/jobs/job_manager.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <stop_token>
#include <thread>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "server/jobs/child_process.h"
#include "server/jobs/deletion.h"
#include "server/jobs/input_check.h"
#include "server/jobs/inventory.h"
#include "server/jobs/task_host.h"
#include "server/jobs/task_protocol.h"
#include "server/jobs/task_runner.h"
#include "server/store/error_info.h"
#include "server/store/files.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

namespace fs = std::filesystem;

// Stages change many times a second; watchers get to see a few of them.
constexpr absl::Duration kStageGap = absl::Milliseconds(200);
constexpr absl::Duration kQueueGap = absl::Seconds(1);  // between two announcements of places in the queue
constexpr size_t kToldAtOnce = 16;                      // of them, without giving others the lock
// How long a worker waits before it asks a store again that has just failed, for instance because the disk is full.
constexpr std::chrono::seconds kStoreRetryGap{1};
// Limits of time are in whole seconds.
constexpr std::chrono::milliseconds kDeadlineGap{500};
constexpr absl::Duration kAlarmGap = absl::Minutes(1);
// A task begins with so many file descriptors left: its own pipes and files, and those of others meanwhile.
constexpr size_t kTaskDescriptors = 16;
// Planning reads lists and no frames, which takes milliseconds. It blocks a thread that answers calls, so only a few
// may wait for it.
constexpr absl::Duration kPlanTime = absl::Seconds(20);
constexpr int kMaxPlansWaiting = 3;

constexpr char kDiskFull[] =
    "disk full: no work is begun until there is room; free some, or delete jobs and recordings";
constexpr char kNoDescriptors[] =
    "no file descriptors left: no work is begun until there are some; raise the limit of open files, or have fewer "
    "connections";

bool HasDescriptors() {
  std::vector<int> taken;
  while (taken.size() < kTaskDescriptors) {
    const int fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (fd < 0) break;
    taken.push_back(fd);
  }
  for (const int fd : taken) close(fd);
  return taken.size() == kTaskDescriptors;
}

// A status for the log, without its payload.
std::string Words(const absl::Status& status) {
  return status.ok() ? "OK" : absl::StrCat(absl::StatusCodeToString(status.code()), ": ", status.message());
}

class Manager : public JobManager {
 public:
  Manager(DataDirectory& directory, Store& store, const JobManagerOptions& options)
      : directory_(directory),
        store_(store),
        options_(options),
        host_(options.core_program),
        runner_(directory, store, damage_, options, &host_),
        inputs_(directory, store, damage_),
        errands_(directory, {.core_program = options.core_program,
                             .host = &host_,
                             .threads = options.frame_renderers,
                             .time_limit = options.frame_render_time,
                             .grace = options.grace,
                             .child_memory_bytes = options.child_memory_bytes,
                             .child_file_bytes = options.child_file_bytes}),
        planning_(directory, {.core_program = options.core_program,
                              .host = &host_,
                              .threads = 1,
                              .max_waiting = kMaxPlansWaiting,
                              .time_limit = kPlanTime,
                              .grace = options.grace,
                              .child_memory_bytes = options.child_memory_bytes,
                              .child_file_bytes = options.child_file_bytes}) {}

  ~Manager() override {
    for (std::jthread& worker : workers_) worker.request_stop();
    {
      // A worker claims with changes_ held and not after it was told to stop, so none is missed.
      const std::lock_guard lock(changes_);
      for (auto& [number, running] : running_) running.stop.request_stop();
    }
    workers_.clear();
    // So that a failure counts after the next start too, which would else release the task without blame.
    for (const Postponed& end : postponed_) RecordOutcome(end.task, end.outcome).IgnoreError();
  }

  absl::Status CleanUpAndStart();

  void Wake() override;
  absl::StatusOr<JobView> Create(const Tenant& tenant, const NewJob& job, std::string_view request_id,
                                 bool validate_only) override;
  absl::StatusOr<JobView> Get(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<Page<JobView>> List(const Tenant& tenant, const JobFilter& filter, const PageRequest& page,
                                     JobDetail detail) override;
  absl::Status Delete(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<JobView> Cancel(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<JobView> Retry(const Tenant& tenant, std::string_view id) override;
  absl::StatusOr<JobView> Pin(const Tenant& tenant, std::string_view id, bool pinned) override;
  absl::Status Collect(const Collectable& job) override;
  absl::StatusOr<std::unique_ptr<JobWatch>> Watch(const Tenant& tenant, std::string_view id,
                                                  std::string_view resume_token,
                                                  std::function<void()> on_news) override;
  absl::StatusOr<std::vector<FrameRecord>> Frames(const Tenant& tenant, std::string_view id, int first, int count,
                                                  int render) override {
    return store_.JobFrames(tenant, id, first, count, render);
  }
  std::string FrameFile(std::string_view id, const OutputSpec& output, std::string_view stem) const override;
  std::string OutputFile(std::string_view id, const OutputSpec& output) const override;
  absl::StatusOr<std::unique_ptr<Errand>> RenderFrame(const Tenant& tenant, std::string_view id,
                                                      const FrameRenderOrder& order,
                                                      std::function<void()> on_done) override;
  absl::StatusOr<std::optional<FileChecksum>> Checksum(std::string_view id, const OutputSpec& output,
                                                       std::string_view stem) override {
    return store_.JobFile(id, PathInJob(output, stem));
  }
  absl::Status Damaged(std::string_view id, const OutputSpec& output, std::string_view stem, int frame) override;
  DamageLog& damage() override { return damage_; }
  void StopErrands() override {
    planning_.Stop();
    errands_.Stop();
  }
  void StopValidation(std::string_view sequence_id) override;
  void SetDraining(bool draining) override;
  bool IsDraining() override;
  void Drain(absl::Duration patience) override;
  std::vector<server::RunningTask> RunningTasks() override;
  ValidationProgress GetValidationProgress(std::string_view sequence_id) override;
  int workers() const override { return options_.workers; }
  absl::StatusOr<Gauges> Measure() override;

 private:
  // What is known of a job only while it runs.
  struct Live {
    std::string stage;
    absl::Time stage_published = absl::InfinitePast();
  };
  struct Running {
    Task task;
    absl::Time start_time;
    std::stop_source stop;
  };

  // An attempt that went wrong and whose failure is recorded later: only then can the work be claimed again.
  struct Postponed {
    Task task;
    TaskOutcome outcome;
    absl::Time due;
  };

  // Tells those who watch queued jobs when these have moved up, once a second however many jobs end: one question
  // to the store for all of them.
  void TellQueue(const std::stop_token& stop);
  // A worker: claims and runs until it is told to stop.
  void Work(const std::stop_token& stop);
  std::optional<Task> ClaimOrWait(const std::stop_token& stop);
  // What a worker may do about validations now, so that they leave workers to jobs. With changes_ held.
  ClaimValidations ValidationsAllowed() const;
  // Whether there is what work needs: space on the disk, and file descriptors. Raises the alarm, now and then, if not.
  // With changes_ held.
  bool MayBegin();
  // What an attempt lacked, in the words of the alarm, if it failed for that; null otherwise.
  const char* RanOutOf(const absl::Status& error) const;
  void RunTask(const Task& task, const std::stop_token& stop);
  // Records how a task ended and tells watchers, however often that takes. With changes_ held by `lock`.
  void Settle(const Task& task, const TaskOutcome& outcome, const std::stop_token& stop,
              std::unique_lock<std::mutex>& lock);
  // Tries the same once. With changes_ held.
  absl::Status RecordAndTell(const Task& task, const TaskOutcome& outcome);
  // Settles what has been postponed long enough. With changes_ held.
  void SettleWhatIsDue();
  absl::Duration Backoff(int failures);
  absl::Status RecordOutcome(const Task& task, const TaskOutcome& outcome);
  void OnStage(const std::string& job_id, std::string_view stage);
  absl::Status OnInterval(const Task& task, const PlannedInterval& interval, double seconds,
                          const std::vector<FileChecksum>& files);
  static std::string PathInJob(const OutputSpec& output, std::string_view stem) {
    const std::string path = "out/" + output.file_name;
    return stem.empty() ? path : absl::StrCat(path, "/", std::string(stem), ".", output.extension);
  }

  // The job with its renders planned; unchanged where there is no sequence to plan it for. FailedPrecondition
  // (NO_SCENE_FLOW) when it asks for scene flow that the sequence cannot give.
  absl::StatusOr<NewJob> Plan(const Tenant& tenant, const NewJob& order);

  // With changes_ held.
  JobView View(JobRecord record) const;
  absl::StatusOr<JobView> Publish(std::string_view job_id, JobEvent::Kind kind);
  void StopTasksOf(std::string_view job_id);
  absl::Status DeleteJobWithFiles(std::string_view id, const std::function<absl::Status()>& forget);
  // The timekeeper: ends jobs that are beyond their limits of time, until it is told to stop.
  void EndOverdueJobs(const std::stop_token& stop);

  DataDirectory& directory_;
  Store& store_;
  const JobManagerOptions options_;
  DamageLog damage_;
  TaskHost host_;  // all that launch with it stand below
  TaskRunner runner_;
  InputCheck inputs_;

  // Held over every change of a job together with its announcement, so that watchers hear of changes in their order and
  // a snapshot is neither older nor newer than the events around it. Not held while a child runs or frames are moved.
  std::mutex changes_;
  WatchHub hub_;                                                        // published to with changes_ held
  std::map<std::string, Live, std::less<>> live_;                       // guarded by changes_; by job id
  std::map<int64_t, Running> running_;                                  // guarded by changes_; by task number
  std::map<std::string, ValidationProgress, std::less<>> validations_;  // guarded by changes_; by sequence id
  bool release_first_ = false;  // guarded by changes_: tasks of the server before are still recorded as running
  int64_t wakes_ = 0;           // guarded by changes_
  bool queue_moved_ = false;    // guarded by changes_: since it was last told
  absl::Time begin_nothing_before_ = absl::InfinitePast();  // guarded by changes_: something was scarce
  const char* scarce_ = nullptr;                            // guarded by changes_: what that was
  absl::Time next_alarm_ = absl::InfinitePast();            // guarded by changes_
  bool draining_ = false;                                   // guarded by changes_: nothing is begun
  bool validated_last_ = false;                             // guarded by changes_: what was claimed last
  std::vector<Postponed> postponed_;                        // guarded by changes_
  std::minstd_rand random_{std::random_device{}()};         // guarded by changes_
  std::condition_variable_any work_, queue_changed_;

  Errands errands_;   // frames on demand
  Errands planning_;  // of orders: apart, so that orders need not wait for pictures
  // Last: they use all of the above.
  std::jthread timekeeper_, queue_teller_;
  std::vector<std::jthread> workers_;
};

absl::Status Manager::CleanUpAndStart() {
  if (access(options_.core_program.c_str(), X_OK) != 0) {
    return ErrnoStatus(errno, "run the program " + options_.core_program);
  }
  RETURN_IF_ERROR(CheckStoreIsOfFolder(directory_, store_, options_.accept_new_store));
  // After a killed server: end its children, remove their scratch folders, which may make the room to record that their
  // work is to be done again.
  const std::vector<std::string> tasks = NamesIn(directory_.TasksFolder());
  for (const std::string& task : tasks) KillLeftChild(directory_.TasksFolder() + "/" + task);
  for (const std::string& task : tasks) RETURN_IF_ERROR(directory_.Discard(directory_.TasksFolder() + "/" + task));
  if (const absl::Status released = store_.ReleaseAllTasks(); absl::IsResourceExhausted(released)) {
    // On a full disk the server still serves and deletes; the workers try again before they claim anything.
    LogError("cannot take back the work of the server before", {{"error", Words(released)}});
    release_first_ = true;
  } else {
    RETURN_IF_ERROR(released);
  }
  RETURN_IF_ERROR(QuarantineWhatHasNoRecord(directory_, store_));
  timekeeper_ = std::jthread([this](const std::stop_token& stop) { EndOverdueJobs(stop); });
  queue_teller_ = std::jthread([this](const std::stop_token& stop) { TellQueue(stop); });
  for (int i = 0; i < options_.workers; ++i) {
    workers_.emplace_back([this](const std::stop_token& stop) { Work(stop); });
  }
  return absl::OkStatus();
}

void Manager::Wake() {
  {
    const std::lock_guard lock(changes_);
    ++wakes_;
  }
  work_.notify_all();
}

JobView Manager::View(JobRecord record) const {
  const auto live = live_.find(record.id);
  const std::string_view stage = live == live_.end() ? std::string_view() : std::string_view(live->second.stage);
  Progress progress = DescribeProgress(record, stage, options_.workers);
  const absl::Time expire_time = ExpireTime(options_.retention, record);
  return {.record = std::move(record), .progress = std::move(progress), .expire_time = expire_time};
}

absl::StatusOr<JobView> Manager::Publish(std::string_view job_id, JobEvent::Kind kind) {
  ASSIGN_OR_RETURN(JobRecord record, store_.GetJob(Tenant::Everyone(), job_id));
  if (record.state != JobState::kRunning) live_.erase(record.id);
  JobView view = View(std::move(record));
  hub_.Publish(kind, view);
  if (HasEnded(view.record.state)) {
    queue_moved_ = true;
    queue_changed_.notify_one();
  }
  return view;
}

void Manager::TellQueue(const std::stop_token& stop) {
  std::unique_lock lock(changes_);
  while (queue_changed_.wait(lock, stop, [this] { return queue_moved_; }) && !stop.stop_requested()) {
    queue_moved_ = false;
    lock.unlock();
    const absl::StatusOr<std::map<std::string, int, std::less<>>> places = store_.QueuePositions();
    lock.lock();
    // A job that has left the queue meanwhile was published, and is not among these.
    for (bool more = places.ok(); more && !stop.stop_requested();) {
      std::vector<JobRecord> moved = hub_.Moved(*places, kToldAtOnce);
      more = moved.size() == kToldAtOnce;
      for (JobRecord& record : moved) hub_.Publish(JobEvent::Kind::kProgress, View(std::move(record)));
      // Who waits for the lock has it in between.
      lock.unlock();
      std::this_thread::yield();
      lock.lock();
    }
    work_.wait_for(lock, stop, absl::ToChronoNanoseconds(kQueueGap), [] { return false; });
  }
}

void Manager::StopTasksOf(std::string_view job_id) {
  for (auto& [number, running] : running_) {
    if (running.task.job_id == job_id) running.stop.request_stop();
  }
  // What waits for another attempt gets none. The caller tells of its end. It stays in the list, which somebody may be
  // walking through, until SettleWhatIsDue finds that there is nothing left to record.
  for (Postponed& end : postponed_) {
    if (end.task.job_id != job_id) continue;
    RecordOutcome(end.task, end.outcome).IgnoreError();
    end.due = absl::InfinitePast();
  }
}

absl::StatusOr<NewJob> Manager::Plan(const Tenant& tenant, const NewJob& order) {
  ASSIGN_OR_RETURN(NewJob job, order.Checked());
  if (!job.webhook_url.empty()) {
    RETURN_IF_ERROR(options_.check_webhook ? options_.check_webhook(job.webhook_url)
                                           : InvalidField("job.webhook", "cannot be served: this server sends none"));
  }
  if (job.threads > options_.max_threads) {
    return BadField("job.threads", absl::StrFormat("job.threads = %d, must be at most %d, which is what this server "
                                                   "gives a task; leave it out to let the server decide",
                                                   job.threads, options_.max_threads));
  }
  const bool scene_flow = job.kind == JobKind::kSceneFlow;
  if (job.renders.empty() && !scene_flow) return job;
  const absl::StatusOr<SequenceRecord> sequence = store_.GetSequence(tenant, job.sequence_id);
  if (!sequence.ok() || sequence->state != SequenceState::kReady) return job;
  const absl::StatusOr<std::string> answer =
      planning_.Run({.arguments = {"plan", "--sequence", directory_.SequenceFolder(job.sequence_id)},
                     .options = OrderJson(job.kind, job.options, job.renders),
                     .field_prefix = "job."});
  if (scene_flow && absl::IsFailedPrecondition(answer.status())) {
    const std::string name = "sequences/" + job.sequence_id;
    return WithErrorInfo(WithContext(answer.status(), name),
                         {.reason = "NO_SCENE_FLOW", .metadata = {{"resource", name}}});
  }
  RETURN_IF_ERROR(answer.status());
  ASSIGN_OR_RETURN(job.renders, ParseRenderPlans(*answer, job.renders));
  return job;
}

absl::StatusOr<JobView> Manager::Create(const Tenant& tenant, const NewJob& job, std::string_view request_id,
                                        bool validate_only) {
  ASSIGN_OR_RETURN(const NewJob planned, Plan(tenant, job));
  std::unique_lock lock(changes_);
  ASSIGN_OR_RETURN(JobRecord record, store_.CreateJob(tenant, planned, request_id, validate_only));
  JobView view = View(std::move(record));
  lock.unlock();
  if (!validate_only) Wake();
  return view;
}

absl::StatusOr<JobView> Manager::Get(const Tenant& tenant, std::string_view id) {
  const std::lock_guard lock(changes_);
  ASSIGN_OR_RETURN(JobRecord record, store_.GetJob(tenant, id));
  return View(std::move(record));
}

absl::StatusOr<Page<JobView>> Manager::List(const Tenant& tenant, const JobFilter& filter, const PageRequest& page,
                                            JobDetail detail) {
  // A list is of no one moment, so that nobody waits for a long one.
  ASSIGN_OR_RETURN(Page<JobRecord> records, store_.ListJobs(tenant, filter, page, detail));
  const std::lock_guard lock(changes_);
  Page<JobView> views{.next_token = std::move(records.next_token)};
  for (JobRecord& record : records.items) views.items.push_back(View(std::move(record)));
  return views;
}

absl::Status Manager::Delete(const Tenant& tenant, std::string_view id) {
  return DeleteJobWithFiles(id, [&] { return store_.DeleteJob(tenant, id); });
}

absl::Status Manager::Collect(const Collectable& job) {
  return DeleteJobWithFiles(job.id, [&] { return store_.CollectJob(job); });
}

absl::Status Manager::DeleteJobWithFiles(std::string_view id, const std::function<absl::Status()>& forget) {
  const auto forget_and_tell = [&]() -> absl::Status {
    const std::lock_guard lock(changes_);
    RETURN_IF_ERROR(forget());
    hub_.Forget(id);
    return absl::OkStatus();
  };
  return DeleteWithFiles(absl::StrCat("jobs/", std::string(id)), forget_and_tell,
                         [&] { return directory_.Discard(directory_.JobFolder(id)); });
}

absl::StatusOr<JobView> Manager::Pin(const Tenant& tenant, std::string_view id, bool pinned) {
  const std::lock_guard lock(changes_);
  ASSIGN_OR_RETURN(JobRecord record, store_.PinJob(tenant, id, pinned));
  return View(std::move(record));
}

absl::StatusOr<JobView> Manager::Cancel(const Tenant& tenant, std::string_view id) {
  const std::lock_guard lock(changes_);
  ASSIGN_OR_RETURN(const JobRecord before, store_.GetJob(tenant, id));
  ASSIGN_OR_RETURN(JobRecord after, store_.CancelJob(tenant, id));
  StopTasksOf(id);
  return after.state == before.state ? View(std::move(after)) : Publish(id, JobEvent::Kind::kState);
}

absl::StatusOr<JobView> Manager::Retry(const Tenant& tenant, std::string_view id) {
  std::unique_lock lock(changes_);
  RETURN_IF_ERROR(store_.RetryJob(tenant, id).status());
  absl::StatusOr<JobView> view = Publish(id, JobEvent::Kind::kState);
  lock.unlock();
  Wake();
  return view;
}

absl::StatusOr<std::unique_ptr<JobWatch>> Manager::Watch(const Tenant& tenant, std::string_view id,
                                                         std::string_view resume_token, std::function<void()> on_news) {
  const std::lock_guard lock(changes_);
  ASSIGN_OR_RETURN(JobRecord record, store_.GetJob(tenant, id));
  return hub_.Watch(View(std::move(record)), resume_token, std::move(on_news));
}

std::string Manager::FrameFile(std::string_view id, const OutputSpec& output, std::string_view stem) const {
  return absl::StrCat(OutputFile(id, output), "/", std::string(stem), ".", output.extension);
}

std::string Manager::OutputFile(std::string_view id, const OutputSpec& output) const {
  return absl::StrCat(directory_.OutFolder(id), "/", output.file_name);
}

absl::Status Manager::Damaged(std::string_view id, const OutputSpec& output, std::string_view stem, int frame) {
  const std::string job = absl::StrCat("jobs/", std::string(id)),
                    file = absl::StrCat(job, "/", PathInJob(output, stem));
  damage_.Report(file, "its bytes are not those that were stored");
  return FileDamaged(absl::StrCat(job, "/outputs/", output.id), file, frame);
}

absl::StatusOr<std::unique_ptr<Errand>> Manager::RenderFrame(const Tenant& tenant, std::string_view id,
                                                             const FrameRenderOrder& order,
                                                             std::function<void()> on_done) {
  ASSIGN_OR_RETURN(const JobRecord job, store_.GetJob(tenant, id));
  if (job.kind != JobKind::kUpsample) {
    return WithErrorInfo(
        absl::FailedPreconditionError(absl::StrCat("jobs/", job.id, " has scene flow and no depth to render from")),
        {.reason = "NO_DEPTH", .metadata = {{"resource", "jobs/" + job.id}}});
  }
  ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, store_.JobFrames(tenant, id, order.frame, 1));
  if (job.frames_total > 0 && order.frame >= job.frames_total) {
    return WithErrorInfo(
        absl::OutOfRangeError(absl::StrFormat("frame = %d, the job has %d frames", order.frame, job.frames_total)),
        {.reason = "NO_SUCH_FRAME", .metadata = {{"frame_count", absl::StrCat(job.frames_total)}}});
  }
  if (frames.empty() || !frames[0].ready) {
    return WithErrorInfo(absl::FailedPreconditionError(absl::StrFormat("frame %d is not finished, %d of %d are",
                                                                       order.frame, job.frames_done, job.frames_total)),
                         {.reason = "FRAME_NOT_READY", .metadata = {{"frame", absl::StrCat(order.frame)}}});
  }
  if (const absl::Status sequence = store_.GetSequence(tenant, job.sequence_id).status(); !sequence.ok()) {
    return WithErrorInfo(
        absl::FailedPreconditionError(absl::StrCat("the colour frames are gone: ", sequence.message())),
        {.reason = "SEQUENCE_GONE", .metadata = {{"resource", "sequences/" + job.sequence_id}}});
  }
  RETURN_IF_ERROR(inputs_.OfFrame(job, frames[0]));
  return errands_.Start(
      {.arguments = {"render-frame", "--sequence", directory_.SequenceFolder(job.sequence_id), "--constants",
                     directory_.JobFolder(job.id) + "/constants.json", "--result", directory_.OutFolder(job.id),
                     "--frame", absl::StrCat(order.frame), "--threads", absl::StrCat(options_.default_threads)},
       .options = FrameRenderJson(job.options, order.options, order.jpeg),
       .field_prefix = "",
       .job_id = job.id,
       .sequence_id = job.sequence_id},
      std::move(on_done));
}

void Manager::StopValidation(std::string_view sequence_id) {
  const std::lock_guard lock(changes_);
  for (auto& [number, running] : running_) {
    const Task& task = running.task;
    if (task.kind == TaskKind::kValidate && task.sequence_id == sequence_id) running.stop.request_stop();
  }
}

ValidationProgress Manager::GetValidationProgress(std::string_view sequence_id) {
  const std::lock_guard lock(changes_);
  const auto found = validations_.find(sequence_id);
  return found == validations_.end() ? ValidationProgress{} : found->second;
}

void Manager::SetDraining(bool draining) {
  {
    const std::lock_guard lock(changes_);
    draining_ = draining;
  }
  Wake();
}

bool Manager::IsDraining() {
  const std::lock_guard lock(changes_);
  return draining_;
}

std::vector<RunningTask> Manager::RunningTasks() {
  std::vector<RunningTask> tasks;
  {
    const std::lock_guard lock(changes_);
    for (const auto& [number, running] : running_)
      tasks.push_back({.task = running.task, .start_time = running.start_time});
  }
  for (RunningTask& running : tasks) {
    const Task& task = running.task;
    if (task.job_id.empty()) {
      const absl::StatusOr<SequenceRecord> sequence = store_.GetSequence(Tenant::Everyone(), task.sequence_id);
      if (sequence.ok()) running.tenant = sequence->tenant;
    } else {
      const absl::StatusOr<JobRecord> job = store_.GetJob(Tenant::Everyone(), task.job_id);
      if (job.ok()) running.tenant = job->tenant;
    }
  }
  return tasks;
}

void Manager::EndOverdueJobs(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any woken;
  std::unique_lock waits(mutex);
  while (!stop.stop_requested()) {
    {
      const std::lock_guard lock(changes_);
      const absl::StatusOr<std::vector<std::string>> overdue = store_.FailOverdueJobs(options_.time_limits);
      if (!overdue.ok()) LogError("cannot end overdue jobs", {{"error", Words(overdue.status())}});
      for (const std::string& id : overdue.ok() ? *overdue : std::vector<std::string>()) {
        LogWarning("job is beyond its time limit", {{"job", id}});
        StopTasksOf(id);
        (void)Publish(id, JobEvent::Kind::kState);
      }
    }
    woken.wait_for(waits, stop, kDeadlineGap, [] { return false; });
  }
}

void Manager::Drain(absl::Duration patience) {
  std::unique_lock lock(changes_);
  draining_ = true;
  // Tasks that end wake all who wait for work_.
  work_.wait_for(lock, absl::ToChronoNanoseconds(patience), [this] { return running_.empty(); });
}

absl::StatusOr<Gauges> Manager::Measure() {
  ASSIGN_OR_RETURN(const std::vector<Store::JobCount> counts, store_.CountJobs());
  Gauges gauges = {.workers = options_.workers, .free_disk_bytes = directory_.FreeBytes().value_or(-1)};
  for (const Store::JobCount& entry : counts) {
    gauges.jobs[{entry.tenant, std::string(ToString(entry.state))}] = entry.count;
  }
  const std::lock_guard lock(changes_);
  gauges.busy_workers = static_cast<int>(running_.size());
  return gauges;
}

void Manager::Work(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    if (const std::optional<Task> task = ClaimOrWait(stop)) RunTask(*task, stop);
  }
}

bool Manager::MayBegin() {
  const absl::Time now = absl::Now();
  const absl::StatusOr<int64_t> free_bytes = directory_.FreeBytes();
  const char* scarce = now < begin_nothing_before_ ? scarce_ : nullptr;
  if (!HasDescriptors()) scarce = kNoDescriptors;
  if (free_bytes.ok() && *free_bytes < options_.min_free_bytes) scarce = kDiskFull;
  if (scarce == nullptr) return true;
  if (now >= next_alarm_) {
    LogError(scarce, {{"free_bytes", absl::StrCat(free_bytes.value_or(-1))},
                      {"needed_bytes", absl::StrCat(options_.min_free_bytes)}});
    next_alarm_ = now + kAlarmGap;
  }
  return false;
}

const char* Manager::RanOutOf(const absl::Status& error) const {
  if (absl::IsUnavailable(error)) return kNoDescriptors;
  if (options_.min_free_bytes == 0 || !absl::IsResourceExhausted(error)) return nullptr;
  const absl::StatusOr<int64_t> free_bytes = directory_.FreeBytes();
  return free_bytes.ok() && *free_bytes < options_.min_free_bytes ? kDiskFull : nullptr;
}

ClaimValidations Manager::ValidationsAllowed() const {
  if (options_.workers == 1) return validated_last_ ? ClaimValidations::kLast : ClaimValidations::kFirst;
  const auto validating = std::count_if(running_.begin(), running_.end(), [](const auto& entry) {
    return entry.second.task.kind == TaskKind::kValidate;
  });
  return validating < options_.workers / 2 ? ClaimValidations::kFirst : ClaimValidations::kNone;
}

std::optional<Task> Manager::ClaimOrWait(const std::stop_token& stop) {
  std::unique_lock lock(changes_);
  if (stop.stop_requested()) return std::nullopt;
  if (draining_) {
    work_.wait(lock, stop, [this] { return !draining_; });
    return std::nullopt;
  }
  if (!MayBegin()) {
    work_.wait_for(lock, stop, kStoreRetryGap, [] { return false; });
    return std::nullopt;
  }
  if (release_first_) {
    if (const absl::Status released = store_.ReleaseAllTasks(); !released.ok()) {
      LogError("cannot take back the work of the server before", {{"error", Words(released)}});
      work_.wait_for(lock, stop, kStoreRetryGap, [] { return false; });
      return std::nullopt;
    }
    release_first_ = false;
  }
  SettleWhatIsDue();
  absl::StatusOr<std::optional<Task>> claimed = store_.ClaimTask(
      [this](const JobRecord& job, TaskKind kind) { return IntervalsPerBatch(job, kind, options_.workers); },
      ValidationsAllowed());
  if (claimed.ok() && claimed->has_value()) {
    const Task& task = **claimed;
    Running& running = running_[task.number];
    running.task = task;
    running.start_time = absl::Now();
    validated_last_ = task.kind == TaskKind::kValidate;
    // The first task of a job has made it RUNNING.
    if (!task.job_id.empty() && live_.try_emplace(task.job_id).second) {
      const absl::StatusOr<JobView> job = Publish(task.job_id, JobEvent::Kind::kState);
      if (job.ok()) ObserveQueueWait(absl::ToDoubleSeconds(job->record.start_time - job->record.create_time));
    }
    return *claimed;
  }
  const int64_t seen = wakes_;
  const auto woken = [this, seen] { return wakes_ != seen; };
  if (claimed.ok()) {
    absl::Time next = absl::InfiniteFuture();
    for (const Postponed& end : postponed_) next = std::min(next, end.due);
    if (next == absl::InfiniteFuture()) {
      work_.wait(lock, stop, woken);
    } else {
      work_.wait_for(lock, stop, absl::ToChronoNanoseconds(std::max(next - absl::Now(), absl::ZeroDuration())), woken);
    }
  } else {
    LogError("cannot claim work", {{"error", Words(claimed.status())}});
    work_.wait_for(lock, stop, kStoreRetryGap, woken);
  }
  return std::nullopt;
}

void Manager::RunTask(const Task& task, const std::stop_token& stop) {
  std::stop_token task_stop;
  absl::StatusOr<JobRecord> job = JobRecord();
  {
    const std::lock_guard lock(changes_);
    task_stop = running_[task.number].stop.get_token();
    if (!task.job_id.empty()) job = store_.GetJob(Tenant::Everyone(), task.job_id);
  }
  LogInfo("task started", {{"task", absl::StrCat(task.number)},
                           {"kind", std::string(ToString(task.kind))},
                           {"sequence", task.sequence_id},
                           {"job", task.job_id},
                           {"first_interval", absl::StrCat(task.first_interval)},
                           {"intervals", absl::StrCat(task.interval_count)},
                           {"render", absl::StrCat(task.render)}});
  const TaskEvents events = {
      .on_stage = [&](std::string_view stage) { OnStage(task.job_id, stage); },
      .on_checked =
          [&](int checked, int of) {
            const std::lock_guard lock(changes_);
            validations_[task.sequence_id] = {.checked = checked, .of = of};
          },
      .on_interval =
          [&](const PlannedInterval& interval, double seconds, const std::vector<FileChecksum>& files) {
            return OnInterval(task, interval, seconds, files);
          }};
  const absl::Time start = absl::Now();
  TaskOutcome outcome =
      job.ok() ? runner_.Run(task, *job, task_stop, events) : TaskOutcome{.error = job.status(), .retry = true};
  if (const char* const scarce = outcome.stopped ? nullptr : RanOutOf(outcome.error); scarce != nullptr) {
    outcome.stopped = true;  // released: it is nobody's fault
    const std::lock_guard lock(changes_);
    scarce_ = scarce;
    begin_nothing_before_ = absl::Now() + options_.scarcity_pause;
  }
  const std::string_view kind = ToString(task.kind);
  CountTask(kind,
            outcome.stopped      ? "stopped"
            : outcome.error.ok() ? "done"
                                 : "failed",
            absl::ToDoubleSeconds(absl::Now() - start));
  if (!outcome.stopped && !outcome.error.ok()) {
    CountTaskFailure(kind, absl::StatusCodeToString(outcome.error.code()));
  }
  Log(outcome.error.ok() || outcome.stopped ? LogLevel::kInfo : LogLevel::kWarning, "task ended",
      {{"task", absl::StrCat(task.number)}, {"job", task.job_id}, {"status", Words(outcome.error)}});
  // Before its end is recorded: on a full disk the record may need the room.
  if (const absl::Status discarded = directory_.Discard(directory_.TaskFolder(task.number)); !discarded.ok()) {
    LogWarning("cannot discard a task's folder", {{"error", Words(discarded)}});
  }
  {
    std::unique_lock lock(changes_);
    // Whoever has stopped the task in the meantime waits for its end.
    const bool wanted = !task_stop.stop_requested() && !stop.stop_requested();
    if (outcome.retry && wanted && task.failures + 1 < kMaxAttempts) {
      postponed_.push_back({task, std::move(outcome), absl::Now() + Backoff(task.failures)});
    } else {
      Settle(task, outcome, stop, lock);
    }
    running_.erase(task.number);
    if (task.kind == TaskKind::kValidate) validations_.erase(task.sequence_id);
  }
  // Ending a task may have made the next one.
  Wake();
}

void Manager::OnStage(const std::string& job_id, std::string_view stage) {
  const std::lock_guard lock(changes_);
  const auto live = live_.find(job_id);
  if (live == live_.end() || live->second.stage == stage) return;
  live->second.stage = stage;
  const absl::Time now = absl::Now();
  if (now - live->second.stage_published < kStageGap) return;
  live->second.stage_published = now;
  absl::StatusOr<JobRecord> record = store_.GetJob(Tenant::Everyone(), job_id);
  if (record.ok()) hub_.Publish(JobEvent::Kind::kProgress, View(*std::move(record)));
}

absl::Status Manager::OnInterval(const Task& task, const PlannedInterval& interval, double seconds,
                                 const std::vector<FileChecksum>& files) {
  {
    const std::lock_guard lock(changes_);
    ASSIGN_OR_RETURN(JobRecord record, store_.FinishInterval(task.number, interval.index, seconds, files));
    const std::string render = task.kind == TaskKind::kRender ? record.renders[task.render].name : std::string();
    hub_.Publish(JobEvent::Kind::kFramesReady, View(std::move(record)), interval.first_frame, interval.frame_count,
                 render);
    CountFrames(render.empty() ? "depth" : "render", interval.frame_count);
  }
  // What was computed can be rendered now.
  if (task.kind == TaskKind::kIntervals) Wake();
  return absl::OkStatus();
}

absl::Status Manager::RecordOutcome(const Task& task, const TaskOutcome& outcome) {
  if (outcome.stopped) return store_.ReleaseTask(task.number);
  if (!outcome.error.ok()) {
    return store_.FailTask(task.number, directory_.WithoutPath(outcome.error), outcome.retry);
  }
  switch (task.kind) {
    case TaskKind::kValidate:
      return store_.FinishValidation(task.number, *outcome.validation);
    case TaskKind::kSelfCheck:
      return store_.FinishSelfCheck(task.number, *outcome.self_check);
    case TaskKind::kPrepare:
      return store_.FinishPrepare(task.number, *outcome.plan);
    case TaskKind::kIntervals:
    case TaskKind::kRender:
    case TaskKind::kAssemble:
      return store_.CompleteTask(task.number, outcome.assembled, outcome.files);
  }
  return absl::OkStatus();
}

absl::Duration Manager::Backoff(int failures) {
  return options_.retry_backoff * std::pow(4.0, failures) * std::uniform_real_distribution(0.5, 1.5)(random_);
}

void Manager::SettleWhatIsDue() {
  const absl::Time now = absl::Now();
  std::erase_if(postponed_, [&](Postponed& end) {
    if (end.due > now) return false;
    const absl::Status recorded = RecordAndTell(end.task, end.outcome);
    if (recorded.ok() || absl::IsFailedPrecondition(recorded)) return true;
    LogError("cannot record the end of a task", {{"task", absl::StrCat(end.task.number)}, {"error", Words(recorded)}});
    end.due = now + absl::FromChrono(kStoreRetryGap);
    return false;
  });
}

void Manager::Settle(const Task& task, const TaskOutcome& outcome, const std::stop_token& stop,
                     std::unique_lock<std::mutex>& lock) {
  absl::Status recorded = RecordAndTell(task, outcome);
  // A full disk may have room later. If the server stops first, the next start gives the task back.
  while (!recorded.ok() && !absl::IsFailedPrecondition(recorded) && !stop.stop_requested()) {
    LogError("cannot record the end of a task", {{"task", absl::StrCat(task.number)}, {"error", Words(recorded)}});
    work_.wait_for(lock, stop, kStoreRetryGap, [] { return false; });
    recorded = RecordAndTell(task, outcome);
  }
}

absl::Status Manager::RecordAndTell(const Task& task, const TaskOutcome& outcome) {
  RETURN_IF_ERROR(RecordOutcome(task, outcome));
  if (task.job_id.empty()) return absl::OkStatus();
  const absl::StatusOr<JobRecord> job = store_.GetJob(Tenant::Everyone(), task.job_id);
  // The stage ends with a task that runs alone, and with the last one before assembling.
  const bool over =
      task.kind == TaskKind::kSelfCheck || task.kind == TaskKind::kPrepare || (job.ok() && job->IsComputed());
  if (const auto live = live_.find(task.job_id); over && live != live_.end()) live->second.stage.clear();
  // A job that still runs has its self-check now, or its plan, or one task less. Watchers get measurements too.
  const bool measured =
      task.kind == TaskKind::kSelfCheck ||
      (task.kind == TaskKind::kPrepare && job.ok() && (job->clock_estimate.has_value() || !job->warnings.empty()));
  const bool progressed = job.ok() && job->state == JobState::kRunning && !measured;
  const absl::StatusOr<JobView> view =
      Publish(task.job_id, progressed ? JobEvent::Kind::kProgress : JobEvent::Kind::kState);
  if (view.ok() && HasEnded(view->record.state)) StopTasksOf(task.job_id);
  return absl::OkStatus();
}

}  // namespace

absl::Status JobManagerOptions::Validate() const {
  const auto bad = [](absl::string_view field, auto value, absl::string_view rule) {
    return absl::InvalidArgumentError(absl::StrCat("JobManagerOptions.", field, " = ", value, ", must be ", rule));
  };
  if (workers < 1) return bad("workers", workers, "> 0");
  if (default_threads < 1) return bad("default_threads", default_threads, "> 0");
  if (max_threads < 1) return bad("max_threads", max_threads, "> 0");
  if (max_sequence_pixels < 0) return bad("max_sequence_pixels", max_sequence_pixels, ">= 0 (0 = no limit)");
  if (child_memory_bytes < 0) return bad("child_memory_bytes", child_memory_bytes, ">= 0 (0 = no limit)");
  if (child_file_bytes < 0) return bad("child_file_bytes", child_file_bytes, ">= 0 (0 = no limit)");
  if (frame_renderers < 1) return bad("frame_renderers", frame_renderers, "> 0");
  if (task_cpu_seconds < 0) return bad("task_cpu_seconds", task_cpu_seconds, ">= 0 (0 = no limit)");
  if (task_stall <= absl::ZeroDuration()) return bad("task_stall", absl::FormatDuration(task_stall), "> 0");
  if (retry_backoff < absl::ZeroDuration()) return bad("retry_backoff", absl::FormatDuration(retry_backoff), ">= 0");
  if (frame_render_time <= absl::ZeroDuration()) {
    return bad("frame_render_time", absl::FormatDuration(frame_render_time), "> 0");
  }
  if (time_limits.queue < absl::ZeroDuration()) {
    return bad("time_limits.queue", absl::FormatDuration(time_limits.queue), ">= 0 (0 = no limit)");
  }
  if (time_limits.run < absl::ZeroDuration()) {
    return bad("time_limits.run", absl::FormatDuration(time_limits.run), ">= 0 (0 = no limit)");
  }
  RETURN_IF_ERROR(retention.Validate());
  if (scarcity_pause < absl::ZeroDuration()) return bad("scarcity_pause", absl::FormatDuration(scarcity_pause), ">= 0");
  if (min_free_bytes < 0) return bad("min_free_bytes", min_free_bytes, ">= 0 (0 = no limit)");
  if (grace < absl::ZeroDuration()) return bad("grace", absl::FormatDuration(grace), ">= 0");
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<JobManager>> JobManager::Start(DataDirectory& directory, Store& store,
                                                              const JobManagerOptions& options) {
  RETURN_IF_ERROR(options.Validate());
  auto manager = std::make_unique<Manager>(directory, store, options);
  RETURN_IF_ERROR(manager->CleanUpAndStart());
  return manager;
}

}  // namespace depthtween::server
