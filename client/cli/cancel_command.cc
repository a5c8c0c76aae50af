#include <iostream>
#include <memory>

#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"
#include "client/cli/job_progress.h"

namespace depthtween::cli {
namespace {

struct CancelOptions {
  CommonOptions common;
  std::string job;
};

int Cancel(const CancelOptions& options) {
  const absl::StatusOr<std::string> name = JobName(options.job);
  if (!name.ok()) return Report(name.status());
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  v1::CancelJobRequest request;
  request.set_name(*name);
  const absl::StatusOr<v1::Job> job =
      (*connection)->Call((*connection)->jobs(), &v1::JobService::StubInterface::CancelJob, request);
  if (!job.ok()) return Report(job.status());
  if (options.common.json) {
    PrintJson(ToJson(*job));
  } else {
    std::cout << job->name() << ": " << DescribeProgress(*job) << std::endl;
  }
  return kExitOk;
}

}  // namespace

void AddCancelCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<CancelOptions>();
  CLI::App* command = app.add_subcommand("cancel", "Stop a job; frames already finished stay");
  command->add_option("job", options->job, "jobs/ID, as submit and list print it")->type_name("JOB")->required();
  AddCommonOptions(*command, options->common);
  command->callback([options, exit_code] { *exit_code = Cancel(*options); });
}

}  // namespace depthtween::cli
