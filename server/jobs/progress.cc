#include "server/jobs/progress.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/ascii.h"

namespace depthtween::server {
namespace {

constexpr int kBatchesPerWorker = 4;     // the last batches end within a quarter of a worker's share of each other
constexpr double kMaxBatchSeconds = 60;  // what a crash or a lost claim may cost
constexpr int kMaxUnmeasuredBatch = 8;

std::string Stage(const JobRecord& job, std::string_view running_stage) {
  if (job.state != JobState::kRunning) return absl::AsciiStrToLower(std::string(ToString(job.state)));
  if (!running_stage.empty()) return std::string(running_stage);
  if (job.intervals_total == 0) return "prepare";
  return job.intervals_done == job.intervals_total ? "assemble" : "intervals";
}

}  // namespace

Progress DescribeProgress(const JobRecord& job, std::string_view running_stage, int workers) {
  Progress progress = {.stage = Stage(job, running_stage),
                       .intervals_done = job.intervals_done,
                       .intervals_total = job.intervals_total,
                       .frames_done = job.frames_done,
                       .frames_total = job.frames_total,
                       .queue_position = job.queue_position};
  if (job.state == JobState::kSucceeded) {
    progress.fraction = 1;
  } else if (job.frames_total > 0) {
    // Assembling is still to come when the last frame is done.
    progress.fraction = std::min(0.999, static_cast<double>(job.frames_done) / job.frames_total);
  }
  if (job.state == JobState::kRunning && job.intervals_done > 0) {
    const int left = job.intervals_total - job.intervals_done;
    const int active = std::clamp(left, 1, workers);
    const double seconds = job.interval_seconds / job.intervals_done;
    progress.eta = Eta{.remaining = absl::Seconds(seconds * std::ceil(static_cast<double>(left) / active)),
                       .seconds_per_interval = seconds,
                       .measured_intervals = job.intervals_done,
                       .workers = active};
  }
  return progress;
}

int IntervalsPerBatch(const JobRecord& job, int workers) {
  const int share = (job.intervals_total + kBatchesPerWorker * workers - 1) / (kBatchesPerWorker * workers);
  double bound = kMaxUnmeasuredBatch;
  if (job.intervals_done > 0 && job.interval_seconds > 0) {
    bound = kMaxBatchSeconds * job.intervals_done / job.interval_seconds;
  }
  return std::max(1, static_cast<int>(std::min<double>(share, bound)));
}

}  // namespace depthtween::server
