#include <iostream>
#include <memory>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"
#include "client/cli/job_progress.h"
#include "client/lib/jobs.h"

namespace depthtween::cli {
namespace {

struct StatusOptions {
  CommonOptions common;
  std::string job;
};

int ServerStatus(const CommonOptions& options, const client::Connection& connection) {
  if (options.json) {
    PrintJson(ToJson(connection.server()));
  } else {
    std::cout << "depthtween-server " << connection.server().version() << " at " << connection.options().address << ", "
              << connection.server().workers() << " workers" << std::endl;
  }
  return kExitOk;
}

int Status(const StatusOptions& options) {
  if (options.job.empty()) {
    const auto connection = Connect(options.common);
    return connection.ok() ? ServerStatus(options.common, **connection) : Report(connection.status());
  }
  const absl::StatusOr<std::string> name = JobName(options.job);
  if (!name.ok()) return Report(name.status());
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  const absl::StatusOr<v1::Job> job = client::GetJob(**connection, *name);
  if (!job.ok()) return Report(job.status());
  if (options.common.json) {
    PrintJson(ToJson(*job));
  } else {
    std::cout << job->name() << ": " << DescribeProgress(*job) << "\n"
              << DescribeFailure(*job) << DescribeOptions(*job) << DescribeMeasured(*job) << std::flush;
  }
  return kExitOk;
}

}  // namespace

void AddStatusCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<StatusOptions>();
  CLI::App* command = app.add_subcommand("status", "Show the state of a job or, without a job, of the server");
  command->add_option("job", options->job, "jobs/ID, as submit and list print it")->type_name("JOB");
  AddCommonOptions(*command, options->common);
  command->callback([options, exit_code] { *exit_code = Status(*options); });
}

}  // namespace depthtween::cli
