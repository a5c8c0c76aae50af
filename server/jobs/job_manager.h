// Runs jobs: claims tasks from the store, runs each in a child process, records what is finished, and tells watchers.
//
// Life of a job: self-check, if asked for -> prepare (how the clip is cut, and its constants) -> batches of intervals
// on all workers, computed, and rendered as soon as the frames around them are there -> assemble. A finished interval's
// frames are moved into the job's out folder, made durable and recorded, in this order: after kill -9 nothing recorded
// is computed again, and nothing half-written is ever seen. Work that a caller waits for (planning a job, rendering one
// frame) runs beside the workers. Each attempt at a task writes to a folder of its own, so a child that lives too long
// does no harm.
#ifndef DEPTHTWEEN_SERVER_JOBS_JOB_MANAGER_H_
#define DEPTHTWEEN_SERVER_JOBS_JOB_MANAGER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/jobs/damage_log.h"
#include "server/jobs/errands.h"
#include "server/jobs/progress.h"
#include "server/jobs/retention.h"
#include "server/jobs/watch.h"
#include "server/store/data_directory.h"
#include "server/store/store.h"
#include "server/telemetry/metrics.h"

namespace depthtween::server {

struct JobManagerOptions {
  std::string core_program;  // path of depthtween-core
  int workers = 1;           // tasks that run at the same time, > 0
  int default_threads = 1;   // of a child whose job leaves it to the server, > 0
  int max_threads = 1024;    // that a job may ask for each of its children, > 0
  // Of all frames of a sequence together; 0 = no limit. By default 48,000 full HD frames of each kind, whose validation
  // takes about an hour of processor time.
  int64_t max_sequence_pixels = 200'000'000'000;
  // A child beyond these fails its task; 0 = no limit.
  int64_t child_memory_bytes = int64_t{16} << 30;  // writable memory it maps, touched or not
  int64_t child_file_bytes = int64_t{4} << 30;     // size of any one file it writes
  // Processor time of one task, over all its threads; 0 = no limit. A backstop against work that has no end: the
  // longest task there is, the scene flow and the videos of 100,000 frames at a second and a half each, fits into it.
  int64_t task_cpu_seconds = int64_t{48} * 3600;
  // A task that says nothing for so long is ended, and tried again like one that crashed. Children tell of each stage
  // and each frame: the longest silence is one stage on one interval of large frames, a few minutes.
  absl::Duration task_stall = absl::Minutes(10);
  // Before an attempt that went wrong is followed by another: this after the first, four times as long after each
  // further one, each time between half of it and one and a half.
  absl::Duration retry_backoff = absl::Seconds(1);
  // Between SIGTERM and SIGKILL when a child has to end. Cancel promises the processor within 2 s.
  absl::Duration grace = absl::Seconds(1);
  // Single frames that are rendered at the same time, > 0, and how long one may take.
  int frame_renderers = 2;
  absl::Duration frame_render_time = absl::Seconds(30);

  // While less is free on the disk, no task starts, and a task that runs out of space is queued again instead of
  // failing; 0: no such limit.
  int64_t min_free_bytes = 0;
  // After a task ran out of space, or of file descriptors, it is queued again and none starts for so long.
  absl::Duration scarcity_pause = absl::Seconds(10);
  // Of every job; a job's own limits can only be shorter.
  TimeLimits time_limits;
  // When jobs expire, for their views; a Collector deletes them.
  RetentionRules retention;
  // Whether a new job may name this address for its webhook; empty: none may.
  std::function<absl::Status(std::string_view url)> check_webhook;
  // Go on although the store is new and the folder has recordings or jobs (inventory.h).
  bool accept_new_store = false;

  absl::Status Validate() const;
};

// While a sequence is being validated: frames decoded so far, of how many; 0 of 0 before the child has said.
struct ValidationProgress {
  int checked = 0;
  int of = 0;
};

// The kinds of outputs. kDepth, kUncertainty, kProvenance, kSceneFlow and kPictures are made of frames; the others are
// one file each, there once the job has succeeded.
enum class OutputKind {
  kDepth,
  kUncertainty,
  kProvenance,
  kSceneFlow,
  kReport,
  kTimestamps,
  kCamera,
  kPictures,
  kVideo,
  kPreview
};
struct OutputSpec {
  OutputKind kind;
  std::string id;         // last part of its resource name
  std::string file_name;  // in a result folder; of frames: the folder that holds <stem>.<extension>
  bool frames = false;
  std::string extension = "png";  // of frames
  int render = -1;                // of kPictures and kVideo: into JobRecord::renders
  bool assembled = false;         // of frames: made at the end, for the frames that have it; else with their interval
};
// Of an upsampling: the outputs that each has, then those of its options and its renders. Of a scene flow: its formats.
std::vector<OutputSpec> OutputsOf(const JobRecord& job);

// One task at work.
struct RunningTask {
  Task task;
  std::string tenant;
  absl::Time start_time;
};

// One picture to be rendered now.
struct FrameRenderOrder {
  int frame = 0;
  std::string options;  // of the render: a JSON object, as depthtween-core reads it
  bool jpeg = false;    // else PNG
};

// Threads: all methods may be called concurrently.
class JobManager {
 public:
  // Ends children that a killed server left behind, gives their work back, and starts the workers. Borrows `directory`
  // and `store`. NotFound or PermissionDenied if the program cannot be run.
  static absl::StatusOr<std::unique_ptr<JobManager>> Start(DataDirectory& directory, Store& store,
                                                           const JobManagerOptions& options);
  // Stops the workers: children are ended, their unfinished work goes back to the store.
  virtual ~JobManager() = default;

  // There may be work in the store.
  virtual void Wake() = 0;

  // As in Store; the view adds progress. Of job.renders only `options` is looked at: depthtween-core plans the rest.
  // InvalidArgument names their field, or `job.threads` when that is more than max_threads. FailedPrecondition
  // (NO_SCENE_FLOW) when the sequence has no depth for every colour frame, or too few frames, and the job is to compute
  // its scene flow.
  virtual absl::StatusOr<JobView> Create(const Tenant& tenant, const NewJob& job, std::string_view request_id,
                                         bool validate_only) = 0;
  virtual absl::StatusOr<JobView> Get(const Tenant& tenant, std::string_view id) = 0;
  virtual absl::StatusOr<Page<JobView>> List(const Tenant& tenant, const JobFilter& filter, const PageRequest& page,
                                             JobDetail detail = JobDetail::kFull) = 0;
  virtual absl::Status Delete(const Tenant& tenant, std::string_view id) = 0;
  // Returns at once, usually in kCancelling; the children are gone within the grace and a moment.
  virtual absl::StatusOr<JobView> Cancel(const Tenant& tenant, std::string_view id) = 0;
  virtual absl::StatusOr<JobView> Retry(const Tenant& tenant, std::string_view id) = 0;
  virtual absl::StatusOr<JobView> Pin(const Tenant& tenant, std::string_view id, bool pinned) = 0;
  // As Store::CollectJob, and the files with it.
  virtual absl::Status Collect(const Collectable& job) = 0;

  // See watch.h. The watch must be destroyed before the manager.
  virtual absl::StatusOr<std::unique_ptr<JobWatch>> Watch(const Tenant& tenant, std::string_view id,
                                                          std::string_view resume_token,
                                                          std::function<void()> on_news) = 0;

  // As Store::JobFrames.
  virtual absl::StatusOr<std::vector<FrameRecord>> Frames(const Tenant& tenant, std::string_view id, int first,
                                                          int count, int render = -1) = 0;
  // The file of one frame; it may be read once FrameRecord::ready.
  virtual std::string FrameFile(std::string_view id, const OutputSpec& output, std::string_view stem) const = 0;
  // The file of an output that is one file; it may be read once the job has succeeded.
  virtual std::string OutputFile(std::string_view id, const OutputSpec& output) const = 0;

  // What that file must hold: of an output that is made of frames, the file of the frame with this stem. nullopt if it
  // was made before there were checksums.
  virtual absl::StatusOr<std::optional<FileChecksum>> Checksum(std::string_view id, const OutputSpec& output,
                                                               std::string_view stem = {}) = 0;
  // The error FILE_DAMAGED for a file that holds something else. Logs it, the first time.
  virtual absl::Status Damaged(std::string_view id, const OutputSpec& output, std::string_view stem = {},
                               int frame = -1) = 0;
  // Where damage is reported that is found otherwise.
  virtual DamageLog& damage() = 0;

  // Starts to render one frame of a job from what is finished. Calls `on_done` from another thread when the answer is
  // there, unless the errand was destroyed. FailedPrecondition when the frame is not finished, or the sequence with its
  // colour frames is gone; OutOfRange when there is no such frame; ResourceExhausted (SERVER_BUSY) when too many wait.
  // The answer: the bytes of the picture, or InvalidArgument with a field of `render`, DeadlineExceeded...
  virtual absl::StatusOr<std::unique_ptr<Errand>> RenderFrame(const Tenant& tenant, std::string_view id,
                                                              const FrameRenderOrder& order,
                                                              std::function<void()> on_done) = 0;

  // To be called before the server's calls are ended. Answers calls that wait for planning or rendering, and later
  // ones, Unavailable (SERVER_STOPPING), at once.
  virtual void StopErrands() = 0;

  // Ends the validation of a sequence that has just been deleted: its process is gone within the grace and a moment.
  // Returns at once.
  virtual void StopValidation(std::string_view sequence_id) = 0;
  // Whether work is begun. Everything else goes on while it is not: running tasks, results are read, jobs made and
  // watched.
  virtual void SetDraining(bool draining) = 0;
  virtual bool IsDraining() = 0;
  // Begins no work any more. Returns when no task runs, or after `patience`.
  virtual void Drain(absl::Duration patience) = 0;
  // The tasks that run, in the order in which they began.
  virtual std::vector<RunningTask> RunningTasks() = 0;

  virtual ValidationProgress GetValidationProgress(std::string_view sequence_id) = 0;
  // How many tasks run at the same time.
  virtual int workers() const = 0;
  // What there is to say of jobs, workers and the disk now; `ready` is left to the caller.
  virtual absl::StatusOr<Gauges> Measure() = 0;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_JOB_MANAGER_H_
