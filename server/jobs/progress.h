// How far a job is, in numbers that were measured.
#ifndef DEPTHTWEEN_SERVER_JOBS_PROGRESS_H_
#define DEPTHTWEEN_SERVER_JOBS_PROGRESS_H_

#include <optional>
#include <string>
#include <string_view>

#include "absl/time/time.h"
#include "server/store/records.h"

namespace depthtween::server {

struct Eta {
  absl::Duration remaining;
  // The basis: mean wall time of an interval on one worker, over how many, on how many workers.
  double seconds_per_interval = 0.0;
  int measured_intervals = 0;
  int workers = 0;
  // Of a job with renders: mean wall time of a rendered frame, over how many.
  double seconds_per_rendered_frame = 0.0;
  int measured_rendered_frames = 0;
};

struct Progress {
  // "queued", "self-check", "prepare", a stage of the pipeline, "render", "assemble", "scene flow, frame 3 of 64",
  // "cancelling", or the final state
  std::string stage;
  int intervals_done = 0;
  int intervals_total = 0;
  int frames_done = 0;
  int frames_total = 0;
  int rendered_frames_done = 0;  // of all renders together
  int rendered_frames_total = 0;
  double fraction = 0.0;  // of all frames, rendered ones too; 1 only when the job has succeeded
  // While running, once an interval has been measured, and a rendered frame if there are any. Without assembling, which
  // has not been measured.
  std::optional<Eta> eta;
  std::optional<int> queue_position;
};

// `running_stage` is what the job's children said last; empty if they have not said anything.
Progress DescribeProgress(const JobRecord& job, std::string_view running_stage, int workers);

// How many intervals a worker takes at once, to compute or to render: a quarter of its share of the job, so that all
// workers end at about the same time; at most 60 s of work by what was measured, and at most 8 before anything was. At
// least 1.
int IntervalsPerBatch(const JobRecord& job, TaskKind kind, int workers);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_PROGRESS_H_
