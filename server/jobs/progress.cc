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
  if (job.facts.self_check && !job.self_check) return "self-check";
  if (job.intervals_total == 0) return "prepare";
  if (job.intervals_done < job.intervals_total) return "intervals";
  return job.IsComputed() ? "assemble" : "render";
}

double RenderSeconds(const JobRecord& job) {
  double seconds = 0;
  for (const RenderRecord& render : job.renders) seconds += render.seconds;
  return seconds;
}

}  // namespace

Progress DescribeProgress(const JobRecord& job, std::string_view running_stage, int workers) {
  Progress progress = {.stage = Stage(job, running_stage),
                       .intervals_done = job.intervals_done,
                       .intervals_total = job.intervals_total,
                       .frames_done = job.frames_done,
                       .frames_total = job.frames_total,
                       .rendered_frames_done = job.RenderedFramesDone(),
                       .rendered_frames_total = job.RenderedFramesTotal(),
                       .queue_position = job.queue_position};
  if (job.state == JobState::kSucceeded) {
    progress.fraction = 1;
  } else if (job.frames_total > 0) {
    // Assembling is still to come when the last frame is done.
    progress.fraction = std::min(0.999, static_cast<double>(progress.frames_done + progress.rendered_frames_done) /
                                            (progress.frames_total + progress.rendered_frames_total));
  }
  const int computed = job.depth_from.empty() ? job.intervals_done : 0;
  const bool measured =
      (computed > 0 || !job.depth_from.empty()) && (job.renders.empty() || progress.rendered_frames_done > 0);
  if (job.state == JobState::kRunning && measured && !job.IsComputed()) {
    const int left = job.intervals_total - job.intervals_done;
    const int pictures_left = progress.rendered_frames_total - progress.rendered_frames_done;
    const int active = std::clamp(pictures_left > 0 ? std::max(left, workers) : left, 1, workers);
    const double seconds = computed > 0 ? job.interval_seconds / computed : 0.0;
    const double picture_seconds = pictures_left > 0 ? RenderSeconds(job) / progress.rendered_frames_done : 0.0;
    progress.eta = Eta{.remaining = absl::Seconds(seconds * std::ceil(static_cast<double>(left) / active) +
                                                  picture_seconds * pictures_left / active),
                       .seconds_per_interval = seconds,
                       .measured_intervals = computed,
                       .workers = active,
                       .seconds_per_rendered_frame = picture_seconds,
                       .measured_rendered_frames = progress.rendered_frames_done};
  }
  return progress;
}

int IntervalsPerBatch(const JobRecord& job, TaskKind kind, int workers) {
  const int share = (job.intervals_total + kBatchesPerWorker * workers - 1) / (kBatchesPerWorker * workers);
  double measured = job.intervals_done, seconds = job.interval_seconds;
  if (kind == TaskKind::kRender) {
    measured = static_cast<double>(job.RenderedFramesDone()) * job.intervals_total / std::max(1, job.frames_total);
    seconds = RenderSeconds(job);
  }
  const double bound = measured > 0 && seconds > 0 ? kMaxBatchSeconds * measured / seconds : kMaxUnmeasuredBatch;
  return std::max(1, static_cast<int>(std::min<double>(share, bound)));
}

}  // namespace depthtween::server
