#include <memory>

#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/job_progress.h"
#include "client/lib/jobs.h"

namespace depthtween::cli {
namespace {

struct WatchOptions {
  CommonOptions common;
  std::string job;
};

int Watch(const WatchOptions& options) {
  const absl::StatusOr<std::string> name = JobName(options.job);
  if (!name.ok()) return Report(name.status());
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  const absl::StatusOr<v1::Job> job =
      options.common.json
          ? client::WatchJob(**connection, *name,
                             [](const v1::JobEvent& event, const v1::Job&) { PrintJson(ToJson(event)); })
          : WatchWithProgressLine(**connection, *name);
  return job.ok() ? ReportOutcome(*job) : Report(job.status());
}

}  // namespace

void AddWatchCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<WatchOptions>();
  CLI::App* command = app.add_subcommand("watch", "Follow a job until it ends; its outcome is the exit code");
  command->add_option("job", options->job, "jobs/ID, as submit and list print it")->type_name("JOB")->required();
  AddCommonOptions(*command, options->common);
  command->get_option("--json")->description("Print every event as a line of JSON on stdout");
  command->callback([options, exit_code] { *exit_code = Watch(*options); });
}

}  // namespace depthtween::cli
