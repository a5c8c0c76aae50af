#include <memory>
#include <vector>

#include "absl/strings/match.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"

namespace depthtween::cli {
namespace {

struct PinOptions {
  CommonOptions common;
  std::vector<std::string> names;
};

template <typename Request, typename Stub, typename Response>
absl::Status CallAbout(client::Connection& connection, Stub& stub,
                       grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                       const std::string& name) {
  Request request;
  request.set_name(name);
  return connection.Call(stub, method, request).status();
}

absl::Status PinOne(client::Connection& connection, const std::string& name, bool pin) {
  using Jobs = v1::JobService::StubInterface;
  using Sequences = v1::SequenceService::StubInterface;
  if (absl::StartsWith(name, "jobs/")) {
    return pin ? CallAbout(connection, connection.jobs(), &Jobs::PinJob, name)
               : CallAbout(connection, connection.jobs(), &Jobs::UnpinJob, name);
  }
  return pin ? CallAbout(connection, connection.sequences(), &Sequences::PinSequence, name)
             : CallAbout(connection, connection.sequences(), &Sequences::UnpinSequence, name);
}

void AddCommand(CLI::App& app, bool pin, int* exit_code) {
  const auto options = std::make_shared<PinOptions>();
  CLI::App* command =
      pin ? app.add_subcommand("pin", "Keep jobs or recordings from being deleted by the server, however old they get")
          : app.add_subcommand("unpin", "Let the server delete jobs or recordings again by its rules");
  command->add_option("name", options->names, "jobs/ID or sequences/ID")->type_name("NAME")->required();
  AddCommonOptions(*command, options->common);
  command->callback([options, pin, exit_code] {
    *exit_code = ForEachResource(
        options->common, options->names, pin ? "pinned" : "unpinned",
        [pin](client::Connection& connection, const std::string& name) { return PinOne(connection, name, pin); });
  });
}

}  // namespace

void AddPinCommands(CLI::App& app, int* exit_code) {
  AddCommand(app, /*pin=*/true, exit_code);
  AddCommand(app, /*pin=*/false, exit_code);
}

}  // namespace depthtween::cli
