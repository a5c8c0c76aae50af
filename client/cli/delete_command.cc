#include <google/protobuf/empty.pb.h>
#include <nlohmann/json.hpp>

#include <iostream>
#include <memory>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"

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

int Delete(const DeleteOptions& options) {
  for (const std::string& name : options.names) {
    if (absl::StartsWith(name, "jobs/") || absl::StartsWith(name, "sequences/")) continue;
    std::cerr << "depthtween: '" << name << "' is neither jobs/ID nor sequences/ID; nothing was deleted" << std::endl;
    return kExitUsage;
  }
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  nlohmann::json deleted = nlohmann::json::array();
  int exit_code = kExitOk;
  for (const std::string& name : options.names) {
    if (const absl::Status status = DeleteOne(**connection, name); !status.ok()) {
      exit_code = Report(status);
      break;
    }
    deleted.push_back(name);
    if (!options.common.json) std::cout << name << std::endl;
  }
  if (options.common.json) PrintJson({{"deleted", deleted}});
  return exit_code;
}

}  // namespace

void AddDeleteCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<DeleteOptions>();
  CLI::App* command =
      app.add_subcommand("delete", "Remove jobs with their results, or recordings; prints what it removed");
  command->add_option("name", options->names, "jobs/ID or sequences/ID")->type_name("NAME")->required();
  AddCommonOptions(*command, options->common);
  command->callback([options, exit_code] { *exit_code = Delete(*options); });
}

}  // namespace depthtween::cli
