#include "client/cli/submission.h"

#include <chrono>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_codes.h"
#include "client/cli/job_progress.h"
#include "client/cli/lost_files.h"
#include "client/cli/progress_line.h"
#include "client/lib/fetch.h"
#include "client/lib/jobs.h"
#include "client/lib/local_sequence.h"
#include "client/lib/upload.h"
#include "core/options/upsample_options.h"

namespace depthtween::cli {
namespace {

void SetDuration(absl::Duration duration, google::protobuf::Duration* message) {
  message->set_seconds(absl::IDivDuration(duration, absl::Seconds(1), &duration));
  message->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(duration)));
}

void AddTimeLimit(CLI::App& command, const std::string& flag, absl::Duration& limit, const std::string& help) {
  command
      .add_option_function<std::string>(
          flag,
          [flag, &limit](const std::string& text) {
            if (!absl::ParseDuration(text, &limit) || limit < absl::Seconds(1)) {
              throw CLI::ValidationError(flag, "'" + text + "', must be a time of at least 1s, such as 90s, 10m or 2h");
            }
          },
          help)
      ->type_name("TIME");
}

double Share(int64_t done, int64_t total) {
  return total > 0 ? static_cast<double>(done) / static_cast<double>(total) : 1.0;
}

absl::Status HashWithProgress(client::LocalSequence& sequence) {
  ProgressLine line("read");
  const std::string total = FormatBytes(sequence.size_bytes);
  return client::HashFiles(sequence, [&](int64_t bytes_done) {
    line.Show(Share(bytes_done, sequence.size_bytes), absl::StrCat(FormatBytes(bytes_done), " of ", total));
  });
}

absl::StatusOr<v1::Sequence> UploadWithProgress(client::Connection& connection, const client::LocalSequence& sequence,
                                                client::UploadProgress& progress) {
  ProgressLine line("upload");
  const auto start = std::chrono::steady_clock::now();
  return client::UploadSequence(connection, sequence, [&](const client::UploadProgress& now) {
    progress = now;
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const int64_t sent = now.bytes_done - now.bytes_found;
    std::string facts = absl::StrCat(FormatBytes(now.bytes_done), " of ", FormatBytes(now.bytes_total));
    if (now.bytes_found > 0) absl::StrAppend(&facts, ", ", FormatBytes(now.bytes_found), " were already there");
    // A rate over less than this is noise.
    if (sent > 0 && seconds > 0.5) {
      absl::StrAppend(&facts, ", ", FormatBytes(static_cast<int64_t>(static_cast<double>(sent) / seconds)), "/s");
    }
    line.Show(Share(now.bytes_done, now.bytes_total), facts);
  });
}

absl::StatusOr<v1::Sequence> ValidateWithProgress(client::Connection& connection, const std::string& name) {
  ProgressLine line("check");
  return client::AwaitValidation(connection, name, [&](const v1::Sequence& sequence) {
    if (sequence.frames_to_check() == 0) return;
    line.Show(Share(sequence.checked_frames(), sequence.frames_to_check()),
              absl::StrCat(sequence.checked_frames(), " of ", sequence.frames_to_check(), " frames"));
  });
}

// Prints what the server found. Returns the exit code of a recording that is not READY.
int ReportRejected(const v1::Sequence& sequence) {
  for (const v1::FileViolation& violation : sequence.violations()) {
    std::cerr << "depthtween: " << Printable(violation.file()) << ": " << PrintableLines(violation.status().message())
              << "\n";
  }
  if (sequence.violations_size() > 0) {
    std::cerr << "depthtween: the server rejects this recording; fix the files above and submit it again" << std::endl;
    return kExitInputRejected;
  }
  std::cerr << "depthtween: the server could not check this recording: " << PrintableLines(sequence.error().message())
            << ". When that is fixed, run 'depthtween delete " << sequence.name() << "' and submit it again"
            << std::endl;
  return kExitFailed;
}

// A failure before the server had the whole recording. One about the files is a rejection.
int ReportInput(const absl::Status& status) {
  const int code = Report(status);
  const bool rejected = absl::IsInvalidArgument(status) || absl::IsNotFound(status) || absl::IsDataLoss(status);
  return rejected ? kExitInputRejected : code;
}

// What a submit reports: filled in as it proceeds, printed once, whatever the outcome.
struct SubmitResult {
  std::optional<v1::Sequence> sequence;
  client::UploadProgress upload;
  std::optional<v1::Job> job;
  std::optional<client::FetchSummary> fetch;
};

void PrintResult(const SubmissionOptions& options, const SubmitResult& result, int exit_code) {
  if (!options.common.json) {
    if (result.job.has_value()) std::cout << result.job->name() << std::endl;
    return;
  }
  nlohmann::json json = {{"exitCode", exit_code}};
  if (result.sequence.has_value()) {
    json["sequence"] = ToJson(*result.sequence);
    json["upload"] = {{"totalBytes", result.upload.bytes_total}, {"foundBytes", result.upload.bytes_found}};
  }
  if (result.job.has_value()) json["job"] = ToJson(*result.job);
  if (result.fetch.has_value()) {
    json["output"] = {
        {"directory", options.output}, {"complete", result.fetch->complete}, {"lost", LostToJson(result.fetch->lost)}};
  }
  PrintJson(json);
}

int Submit(const SubmissionOptions& options, v1::Job order, SubmitResult& result) {
  absl::StatusOr<client::LocalSequence> local = client::FindSequence(options.sequence);
  if (!local.ok()) return ReportInput(local.status());
  if (!options.output.empty()) {
    if (const absl::Status usable = client::CheckFolder(options.output, options.force); !usable.ok()) {
      return Report(usable);
    }
  }
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  if (const absl::Status hashed = HashWithProgress(*local); !hashed.ok()) return ReportInput(hashed);

  absl::StatusOr<v1::Sequence> sequence = UploadWithProgress(**connection, *local, result.upload);
  if (!sequence.ok()) return ReportInput(sequence.status());
  sequence = ValidateWithProgress(**connection, sequence->name());
  if (!sequence.ok()) return Report(sequence.status());
  result.sequence = *sequence;
  if (sequence->state() != v1::Sequence::STATE_READY) return ReportRejected(*sequence);
  for (const std::string& warning : sequence->warnings()) {
    std::cerr << "depthtween: warning: " << PrintableLines(warning) << std::endl;
  }

  order.set_display_name(local->display_name);
  order.set_sequence(sequence->name());
  order.set_threads(options.threads);
  order.set_priority(options.priority);
  order.set_pinned(options.pin);
  SetDuration(options.queue_limit, order.mutable_queue_time_limit());
  SetDuration(options.run_limit, order.mutable_run_time_limit());
  if (!options.webhook.empty()) order.mutable_webhook()->set_url(options.webhook);
  absl::StatusOr<v1::Job> job = client::SubmitJob(**connection, order);
  if (!job.ok()) return Report(job.status());
  result.job = *job;
  if (!options.wait && options.output.empty()) return kExitOk;

  job = WatchWithProgressLine(**connection, job->name());
  if (!job.ok()) return Report(job.status());
  result.job = *job;
  if (const int outcome = ReportOutcome(*job); outcome != kExitOk || options.output.empty()) return outcome;

  const auto fetched = FetchWithProgressLine(**connection, job->name(), options.output, {.replace = options.force});
  if (!fetched.ok()) return Report(fetched.status());
  result.fetch = *fetched;
  if (fetched->lost.empty()) return kExitOk;
  std::cerr << "depthtween: " << DescribeLost(job->name(), fetched->lost, options.output) << std::endl;
  return kExitFailed;
}

}  // namespace

void AddSubmissionOptions(CLI::App& command, SubmissionOptions& options) {
  command
      .add_option("sequence", options.sequence,
                  "Sequence folder: rgb.txt, depth.txt, camera.json and frames; or a zip archive of it")
      ->required()
      ->type_name("SEQ");
  command.add_option("-o,--out", options.output, "Fetch the result into this folder; implies --wait")->type_name("OUT");
  command.add_flag("--force", options.force, "Replace an earlier result in OUT");
  command.add_flag("--wait", options.wait, "Return when the job has ended, with its outcome as exit code");
  command.add_option("--priority", options.priority, "Of your own jobs in the queue the higher goes first, -10 to 10")
      ->check(CLI::Range(-10, 10))
      ->type_name("N");
  command.add_option("--threads", options.threads, "Threads of each worker; 0: the server decides. Same result")
      ->type_name("N")
      ->check(CLI::Range(0, kMaxThreads))
      ->capture_default_str();
  AddTimeLimit(command, "--queue-limit", options.queue_limit,
               "Let the job fail when it has waited so long for its turn, such as 10m or 2h");
  AddTimeLimit(command, "--run-limit", options.run_limit,
               "Let the job fail when it has run so long, by the clock on the wall");
  command.add_flag("--pin", options.pin, "Keep the job from being deleted by the server, see 'depthtween pin'");
  command
      .add_option("--webhook", options.webhook, "POST the job to this address when it has ended, signed by the server")
      ->type_name("URL");
  AddCommonOptions(command, options.common);
}

int RunSubmission(const SubmissionOptions& options, absl::StatusOr<v1::Job> order) {
  SubmitResult result;
  const int exit_code = order.ok() ? Submit(options, *std::move(order), result) : Report(order.status());
  PrintResult(options, result, exit_code);
  return exit_code;
}

}  // namespace depthtween::cli
