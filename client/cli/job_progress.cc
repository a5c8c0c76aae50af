#include "client/cli/job_progress.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "client/cli/common.h"
#include "client/cli/progress_line.h"
#include "client/lib/jobs.h"
#include "core/flags/option_flags.h"
#include "core/options/scene_flow_options.h"
#include "core/options/upsample_options.h"
#include "proto/depthtween/documents.h"

namespace depthtween::cli {

std::string DescribeProgress(const v1::Job& job) {
  const v1::Progress& progress = job.progress();
  std::string state = absl::AsciiStrToLower(StateName(job.state()));
  if (job.state() == v1::Job::STATE_QUEUED) {
    if (!progress.has_queue_position() || progress.queue_position() == 0) return state;
    return absl::StrCat(state, ", ", progress.queue_position(), progress.queue_position() == 1 ? " job" : " jobs",
                        " ahead");
  }
  if (client::HasEnded(job.state()))
    return absl::StrCat(state, ", ", progress.frames_done(),
                        job.has_scene_flow_options() ? " pairs of frames" : " frames");
  std::string text;
  if (progress.frames_total() > 0) {
    text = job.has_scene_flow_options()
               ? absl::StrCat("pair ", progress.frames_done(), " of ", progress.frames_total(), ", ")
               : absl::StrCat("frame ", progress.frames_done(), " of ", progress.frames_total(), ", interval ",
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

namespace {

std::string Millimetres(double value) { return absl::StrFormat("%.1f", value); }

// As `depthtween-core upsample --self-check` prints it.
std::string DescribeSelfCheck(const v1::SelfCheck& check) {
  std::string text = Printable(check.summary()) + "\n";
  if (!check.reason().empty()) return text;
  absl::StrAppendFormat(&text, "\n%-10s  %8s  %8s  %10s  %9s  %8s   (%d of %d held-out depth maps)\n", "self-check",
                        "RMSE mm", "MAE mm", "edge band", "complete", "<1 sigma", check.maps_checked(),
                        check.maps_held_out());
  for (const v1::SelfCheck::Method& method : check.methods()) {
    absl::StrAppendFormat(
        &text, "%-10s  %8s  %8s  %10s  %7.1f %%  %8s\n", Printable(method.name()), Millimetres(method.rmse_mm()),
        Millimetres(method.mae_mm()), method.has_edge_band_rmse_mm() ? Millimetres(method.edge_band_rmse_mm()) : "-",
        100 * method.completeness(),
        method.has_within_one_sigma() ? absl::StrFormat("%.1f %%", 100 * method.within_one_sigma()) : "-");
  }
  absl::StrAppend(&text, "worst frames:");
  for (const v1::SelfCheck::Frame& frame : check.worst_frames()) {
    absl::StrAppendFormat(&text, " %s (%s mm)", Printable(frame.stem()), Millimetres(frame.rmse_mm()));
  }
  return text + "\n";
}

// As `depthtween-core sync` prints it.
std::string DescribeClock(const v1::ClockEstimate& estimate) {
  if (!estimate.reason().empty()) {
    return absl::StrCat("clock: ", Printable(estimate.summary()), "; the stamps are kept\n");
  }
  return absl::StrFormat(
      "clock: %s\n"
      "corrected stamps are right to +-%.2f ms; rows of colour come %.1f us after one another (+-%.1f us)\n",
      Printable(estimate.summary()), 1e-6 * estimate.stamp_sigma_ns(), 1e-3 * estimate.row_time_ns(),
      1e-3 * estimate.row_time_sigma_ns());
}

}  // namespace

std::string DescribeFailure(const v1::Job& job) {
  if (job.state() != v1::Job::STATE_FAILED) return "";
  const absl::Status outcome = client::Outcome(job);
  return absl::StrCat("it failed: ", PrintableLines(std::string(outcome.message())), " (",
                      absl::StatusCodeToString(outcome.code()), ")\n");
}

std::string DescribeOptions(const v1::Job& job) {
  const bool scene_flow = job.has_scene_flow_options();
  const google::protobuf::Message& options =
      scene_flow ? static_cast<const google::protobuf::Message&>(job.scene_flow_options()) : job.options();
  const std::string flags =
      FlagsOf(scene_flow ? SceneFlowOptionSpecs() : UpsampleOptionSpecs(), nlohmann::json::parse(DocumentOf(options)));
  return flags.empty() ? "" : absl::StrCat("asked for: ", Printable(flags), "\n");
}

std::string DescribeMeasured(const v1::Job& job) {
  std::string text;
  if (job.has_self_check()) absl::StrAppend(&text, DescribeSelfCheck(job.self_check()));
  if (job.has_clock_estimate()) absl::StrAppend(&text, DescribeClock(job.clock_estimate()));
  for (const std::string& warning : job.warnings()) {
    // Why there is no clock was said already.
    const bool of_clock = job.has_clock_estimate() && absl::StartsWith(warning, job.clock_estimate().summary());
    if (!of_clock) absl::StrAppend(&text, "warning: ", Printable(warning), "\n");
  }
  return text;
}

absl::StatusOr<v1::Job> WatchWithProgressLine(client::Connection& connection, const std::string& name) {
  ProgressLine line(name);
  std::string said;
  return client::WatchJob(connection, name, [&](const v1::JobEvent&, const v1::Job& job) {
    // Measurements are only ever appended.
    if (const std::string measured = DescribeMeasured(job); measured.size() > said.size()) {
      line.Say(measured.substr(said.size()));
      said = measured;
    }
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
