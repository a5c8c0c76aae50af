#include "client/cli/job_progress.h"

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "client/cli/common.h"
#include "client/cli/progress_line.h"
#include "client/lib/jobs.h"

namespace depthtween::cli {

std::string DescribeProgress(const v1::Job& job) {
  const v1::Progress& progress = job.progress();
  const std::string state = absl::AsciiStrToLower(StateName(job.state()));
  if (job.state() == v1::Job::STATE_QUEUED) {
    if (!progress.has_queue_position() || progress.queue_position() == 0) return state;
    return absl::StrCat(state, ", ", progress.queue_position(), progress.queue_position() == 1 ? " job" : " jobs",
                        " ahead");
  }
  if (client::HasEnded(job.state())) return absl::StrCat(state, ", ", progress.frames_done(), " frames");
  std::string text;
  if (progress.frames_total() > 0) {
    text = absl::StrCat("frame ", progress.frames_done(), " of ", progress.frames_total(), ", interval ",
                        progress.intervals_done(), " of ", progress.intervals_total(), ", ");
  }
  if (progress.rendered_frames_total() > 0) {
    absl::StrAppend(&text, "picture ", progress.rendered_frames_done(), " of ", progress.rendered_frames_total(), ", ");
  }
  absl::StrAppend(&text, job.state() == v1::Job::STATE_RUNNING ? progress.stage() : state);
  if (progress.has_eta()) {
    const auto& remaining = progress.eta().remaining();
    absl::StrAppend(&text, ", ", FormatDuration(static_cast<double>(remaining.seconds()) + remaining.nanos() * 1e-9),
                    " left");
  }
  return text;
}

absl::StatusOr<v1::Job> WatchWithProgressLine(client::Connection& connection, const std::string& name) {
  ProgressLine line(name);
  return client::WatchJob(connection, name, [&](const v1::JobEvent&, const v1::Job& job) {
    line.Show(job.progress().fraction(), DescribeProgress(job));
  });
}

absl::StatusOr<client::FetchSummary> FetchWithProgressLine(client::Connection& connection, const std::string& job,
                                                           const std::string& directory,
                                                           const client::FetchOptions& options) {
  ProgressLine line("fetch");
  return client::FetchResult(connection, job, directory, options, [&](const client::FetchProgress& progress) {
    const std::string received = absl::StrCat(", ", FormatBytes(progress.bytes));
    // Frames of several outputs, so "images": a person counts frames of the clip.
    if (progress.frames_total == 0) {
      line.Show(0.0, absl::StrCat(progress.frames_done, " images", received));
    } else {
      line.Show(static_cast<double>(progress.frames_done) / progress.frames_total,
                absl::StrCat(progress.frames_done, " of ", progress.frames_total, " images", received));
    }
  });
}

}  // namespace depthtween::cli
