// What the store keeps, as plain values.
//
// Ids are 16 lower-case hexadecimal digits chosen at random; the RPC layer prefixes them ("sequences/", "jobs/").
#ifndef DEPTHTWEEN_SERVER_STORE_RECORDS_H_
#define DEPTHTWEEN_SERVER_STORE_RECORDS_H_

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "core/geometry/camera.h"
#include "core/options/job_options.h"
#include "core/sequence/clock_estimate.h"
#include "core/sequence/self_check.h"
#include "server/store/checksums.h"

namespace depthtween::server {

// ---- sequences ----

// kUploading -> kValidating -> kReady | kInvalid
enum class SequenceState { kUploading = 1, kValidating = 2, kReady = 3, kInvalid = 4 };

// What is wrong with one file of a sequence; `file` is its relative path.
struct FileViolation {
  std::string file;
  absl::Status status;
};

// The facts that validation found.
struct Recording {
  Camera camera;
  double depth_scale = 0.0;  // stored 16-bit units per metre
  int color_frame_count = 0;
  int depth_frame_count = 0;
  int64_t first_time_ns = 0;  // of the colour frames
  int64_t last_time_ns = 0;
  double median_depth_m = 0.0;
};

// The outcome of a validation. kReady if and only if `recording` is set.
struct ValidationResult {
  std::vector<FileViolation> violations;
  std::vector<std::string> warnings;
  absl::Status error;  // why the validation itself could not be done
  std::optional<Recording> recording;
};

struct SequenceRecord {
  std::string id;
  std::string display_name;
  SequenceState state = SequenceState::kUploading;
  absl::Time create_time;
  absl::Time update_time;
  int64_t size_bytes = 0;  // announced by its uploads
  int file_count = 0;
  std::string tenant;
  bool pinned = false;          // never collected
  ValidationResult validation;  // empty before kReady or kInvalid
};

// A recording that came as one zip archive.
struct SequenceArchive {
  std::string path;       // of the archive
  bool unpacked = false;  // its files are the sequence's now
};

// ---- uploads ----

struct UploadFile {
  std::string path;  // relative to the sequence, see path_rules.h
  int64_t size_bytes = 0;
  std::string sha256;  // 32 bytes, or empty: unchecked
};

// Some files on their way; their bytes follow one another without gap in the order of the manifest.
struct UploadRecord {
  std::string id;
  std::string sequence_id;
  int64_t size_bytes = 0;
  int64_t committed_size = 0;  // durable, and the next offset
  bool finished = false;
  absl::Time create_time;
  absl::Time expire_time = absl::InfiniteFuture();  // it is kept at least until then; InfiniteFuture: once finished
  std::string metadata;                             // the client's own, printable ASCII
};

// ---- jobs ----

// kQueued -> kRunning -> kSucceeded | kFailed;  kQueued | kRunning -> kCancelling -> kCancelled;
// kFailed | kCancelled -> kQueued (retry)
enum class JobState { kQueued = 1, kRunning = 2, kCancelling = 3, kSucceeded = 4, kFailed = 5, kCancelled = 6 };

inline bool HasEnded(JobState state) {
  return state == JobState::kSucceeded || state == JobState::kFailed || state == JobState::kCancelled;
}

// "QUEUED" and so on: as filters, messages and logs say it.
std::string_view ToString(SequenceState state);
std::string_view ToString(JobState state);

// A product that a job renders of every frame, as depthtween-core planned it from the options.
struct RenderRecord {
  std::string name;
  std::string options;    // a JSON object, as depthtween-core reads it
  int reach_frames = 0;   // a frame needs this many finished ones before and after it
  int anchor_frame = -1;  // and all between itself and this one; -1: none
  bool uses_motion = false;
  std::vector<std::string> streams;  // a picture of every frame each, in <stream>/<stem>.<extension> of the result
  std::string extension;             // png or jpg
  std::vector<std::string> videos;   // files that `assemble` makes; none if no container was asked for
  int frames_done = 0;               // stored and recorded
  double seconds = 0.0;              // wall seconds, summed over them
};

inline constexpr int kMaxPriority = 10;

// How long a job may wait for its first task, and how long it may take from then on, by the clock on the wall. Zero: no
// limit. A job beyond one fails.
inline constexpr absl::Duration kLeastTimeLimit = absl::Seconds(1), kMostTimeLimit = absl::Hours(8784);
struct TimeLimits {
  absl::Duration queue = absl::ZeroDuration();
  absl::Duration run = absl::ZeroDuration();
};

struct NewJob {
  std::string display_name;
  std::string sequence_id;
  JobKind kind = JobKind::kUpsample;
  std::string options = "{}";  // JSON document, read by core/options/job_options.h alone
  int threads = 0;             // of each child; 0: the server decides. The bits do not depend on it.
  int priority = 0;            // -kMaxPriority to kMaxPriority: higher goes first, among jobs of the same tenant
  TimeLimits limits;           // within those of the server
  bool pinned = false;         // never collected
  // Of an upsampling alone.
  std::vector<RenderRecord> renders;
  std::string depth_from;  // id of a job that has this depth already; empty: compute it
  // Of any job: where its end is told; empty: nowhere. Whether it is an address that may be used is the caller's to
  // check.
  std::string webhook_url;

  // The same with its options in canonical form. InvalidArgument with field, value and rule.
  absl::StatusOr<NewJob> Checked() const;
};

// kWaiting (the job has not ended) -> kSending -> kDelivered | kGivenUp; -> kWaiting when the job is queued again
enum class WebhookState { kWaiting = 1, kSending = 2, kDelivered = 3, kGivenUp = 4 };

struct WebhookRecord {
  std::string url;
  WebhookState state = WebhookState::kWaiting;
  int attempts = 0;                               // to tell of this end
  absl::Time next_time = absl::InfiniteFuture();  // of the next attempt, while kSending
  std::string last_error;                         // of the last attempt; empty when there was none
};

// One that is to be sent now.
struct DueWebhook {
  std::string event_id;  // the same in every attempt, another for another end of the same job
  std::string job_id;
  std::string url;
  int attempts = 0;
};

struct JobRecord {
  std::string id;
  int64_t number = 0;  // ascends in the order of creation
  std::string display_name;
  std::string sequence_id;
  JobKind kind = JobKind::kUpsample;
  std::string options;  // canonical
  JobFacts facts;       // of these options
  int threads = 0;
  int priority = 0;
  TimeLimits limits;    // its own
  bool pinned = false;  // never collected
  std::vector<RenderRecord> renders;
  std::string depth_from;
  std::string tenant;
  Recording recording;  // of the sequence when the job was made: it may be deleted later
  JobState state = JobState::kQueued;
  int attempt = 1;
  absl::Status error;  // why it failed
  absl::Time create_time;
  absl::Time start_time;  // InfiniteFuture before
  absl::Time end_time;    // InfiniteFuture before
  int intervals_done = 0;
  int intervals_total = 0;  // 0 before `prepare` has counted
  int frames_done = 0;      // stored and recorded
  int frames_total = 0;
  double interval_seconds = 0.0;                // wall seconds, summed over the intervals done
  std::optional<int> queue_position;            // jobs of its tenant ahead, while kQueued
  std::optional<SelfCheck> self_check;          // once it was measured, if facts.self_check
  std::optional<ClockEstimate> clock_estimate;  // once there is a plan, if the options ask for it
  std::vector<std::string> warnings;            // for people, of the recording; once there is a plan
  std::optional<WebhookRecord> webhook;         // if it asks for one

  // Over all renders.
  int RenderedFramesDone() const;
  int RenderedFramesTotal() const { return frames_total * static_cast<int>(renders.size()); }
  // Every frame is there, and every picture of it.
  bool IsComputed() const;
};

// How much of a job a list wants to know.
enum class JobDetail {
  kFull,
  kBasic  // no recording, self-check and clock estimate; of renders how far they are, and nothing else
};

// A job that has ended, or a recording that no unfinished job needs: what may be deleted to make room.
struct Collectable {
  std::string id;
  std::string tenant;
  JobState job_state = JobState::kSucceeded;  // of a job
  absl::Time since;                           // when it ended; of a recording: when it was last used, or came
};

// ---- work ----

struct PlannedInterval {
  int index = 0;
  int first_frame = 0;
  int frame_count = 0;
  bool held = false;
};

struct PlannedFrame {
  int index = 0;
  int64_t time_ns = 0;
  std::string stem;  // names its files
};

// What `prepare` found: how the clip is cut, and the frames it will have.
struct JobPlan {
  std::vector<PlannedInterval> intervals;
  std::vector<PlannedFrame> frames;
  bool depth_done = false;  // it was taken over from another job
  std::optional<ClockEstimate> clock_estimate;
  std::vector<std::string> warnings;
  std::vector<FileChecksum> files;  // that it left in the job's folder
};

struct FrameRecord {
  int index = 0;
  int64_t time_ns = 0;
  std::string stem;
  bool ready = false;  // its interval is done, or that part of its render: its files are durable and may be read
  // Whether it has a file of the output that `assemble` makes; nullopt: not known (yet).
  std::optional<bool> assembled;
};

enum class TaskKind { kValidate = 1, kPrepare = 2, kIntervals = 3, kAssemble = 4, kRender = 5, kSelfCheck = 6 };

// "validate" and so on: the argument of `depthtween-core task`.
std::string_view ToString(TaskKind kind);

// One attempt at one piece of work. Its number is never used twice: it fences every write about the task, and names the
// folder that only this attempt writes to.
struct Task {
  int64_t number = 0;
  TaskKind kind = TaskKind::kValidate;
  std::string sequence_id;
  std::string job_id;      // empty for kValidate
  int first_interval = 0;  // kIntervals and kRender
  int interval_count = 0;
  int render = 0;    // kRender only: into JobRecord::renders
  int failures = 0;  // of earlier attempts (for kIntervals and kRender: at its first interval)
};

// ---- files ----

// A file whose bytes the store knows.
struct StoredFile {
  std::string path;                      // relative to the data folder: "jobs/ID/out/report.json"
  std::string resource;                  // what it is of: "jobs/ID" or "sequences/ID"
  std::optional<FileChecksum> checksum;  // nullopt: it was stored before there were checksums
};

// How far a scrub is.
struct ScrubRecord {
  absl::Time start_time = absl::InfinitePast();  // of this round; InfinitePast: there has been none
  std::string cursor;                            // as Store::StoredFiles takes it
  bool over = true;                              // every file has been checked in this round
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_RECORDS_H_
