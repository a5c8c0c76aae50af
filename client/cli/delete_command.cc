#include <google/protobuf/empty.pb.h>

#include <memory>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"

namespace depthtween::cli {
namespace {

struct DeleteOptions {
  CommonOptions common;
  std::vector<std::string> names;
};

absl::Status DeleteOne(client::Connection& connection, const std::string& name) {
  if (absl::StartsWith(name, "jobs/")) {
    v1::DeleteJobRequest request;
    request.set_name(name);
    return connection.Remove(connection.jobs(), &v1::JobService::StubInterface::DeleteJob, request);
  }
  v1::DeleteSequenceRequest request;
  request.set_name(name);
  return connection.Remove(connection.sequences(), &v1::SequenceService::StubInterface::DeleteSequence, request);
}

}  // namespace

void AddDeleteCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<DeleteOptions>();
  CLI::App* command =
      app.add_subcommand("delete", "Remove jobs with their results, or recordings; prints what it removed");
  command->add_option("name", options->names, "jobs/ID or sequences/ID")->type_name("NAME")->required();
  AddCommonOptions(*command, options->common);
  command->callback(
      [options, exit_code] { *exit_code = ForEachResource(options->common, options->names, "deleted", DeleteOne); });
}

}  // namespace depthtween::cli
