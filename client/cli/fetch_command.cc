#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"
#include "client/cli/job_progress.h"
#include "client/cli/lost_files.h"
#include "client/lib/fetch.h"
#include "client/lib/jobs.h"

namespace depthtween::cli {
namespace {

struct FetchOptions {
  CommonOptions common;
  std::string job;
  std::string output;
  bool follow = false;
  bool force = false;
};

int Fetch(const FetchOptions& options) {
  const absl::StatusOr<std::string> name = JobName(options.job);
  if (!name.ok()) return Report(name.status());
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  const absl::StatusOr<client::FetchSummary> fetched =
      FetchWithProgressLine(**connection, *name, options.output, {.follow = options.follow, .replace = options.force});
  // Aborted: the followed job ended without success; the job says why.
  if (!fetched.ok() && !absl::IsAborted(fetched.status())) return Report(fetched.status());
  const absl::StatusOr<v1::Job> job = client::GetJob(**connection, *name);
  if (!job.ok()) return Report(job.status());
  if (options.common.json) {
    nlohmann::json json = {{"job", ToJson(*job)}, {"directory", options.output}};
    json["complete"] = fetched.ok() && fetched->complete;
    json["lost"] = LostToJson(fetched.ok() ? fetched->lost : std::vector<client::LostOutput>());
    PrintJson(json);
  }
  if (fetched.ok() && fetched->complete) return kExitOk;
  const bool lost = fetched.ok() && !fetched->lost.empty();
  if (lost) std::cerr << "depthtween: " << DescribeLost(*name, fetched->lost, options.output) << std::endl;
  if (client::HasEnded(job->state()) && job->state() != v1::Job::STATE_SUCCEEDED) return ReportOutcome(*job);
  if (lost) return kExitFailed;
  std::cerr << "depthtween: " << *name << " has not ended (" << DescribeProgress(*job)
            << "); run the command again to fetch the rest, or use --follow to wait for it" << std::endl;
  return kExitNotFinished;
}

}  // namespace

void AddFetchCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<FetchOptions>();
  CLI::App* command =
      app.add_subcommand("fetch", "Fetch the result of a job. If interrupted, the same command resumes");
  command->add_option("job", options->job, "jobs/ID, as submit and list print it")->type_name("JOB")->required();
  command->add_option("-o,--out", options->output, "Folder for the result")->required()->type_name("OUT");
  command->add_flag("--follow", options->follow, "Fetch frames as a running job makes them, until it ends");
  command->add_flag("--force", options->force, "Replace an earlier result in OUT");
  AddCommonOptions(*command, options->common);
  command->callback([options, exit_code] { *exit_code = Fetch(*options); });
}

}  // namespace depthtween::cli
