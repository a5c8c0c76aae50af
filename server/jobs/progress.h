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
};

struct Progress {
  std::string stage;  // "queued", "prepare", a stage of the pipeline, "assemble", "cancelling", or the final state
  int intervals_done = 0;
  int intervals_total = 0;
  int frames_done = 0;
  int frames_total = 0;
  double fraction = 0.0;   // 1 only when the job has succeeded
  std::optional<Eta> eta;  // while running, once one interval has been measured
  std::optional<int> queue_position;
};

// `running_stage` is what the job's children said last; empty if they have not said anything.
Progress DescribeProgress(const JobRecord& job, std::string_view running_stage, int workers);

// How many intervals a worker takes at once: a quarter of its share of the job, so that all workers end at about the
// same time; at most 60 s of work by what was measured, and at most 8 before anything was. At least 1.
int IntervalsPerBatch(const JobRecord& job, int workers);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_PROGRESS_H_
