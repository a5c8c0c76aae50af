// What the subcommands share: the options every one has, names, failures, JSON.
#ifndef DEPTHTWEEN_CLIENT_CLI_COMMON_H_
#define DEPTHTWEEN_CLIENT_CLI_COMMON_H_

#include <google/protobuf/message.h>

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "client/lib/connection.h"
#include "client/lib/server_profile.h"
#include "proto/depthtween/local_address.h"

namespace depthtween::cli {

struct CommonOptions {
  std::string server = LocalServerAddress();  // or a name of the file of servers
  client::ServerProfile profile;              // what flags and environment say beside the address
  double patience_s = 60.0;
  bool json = false;
};

// Adds --server and how to reach it, --patience and --json to a subcommand. `options` must outlive the parsing.
void AddCommonOptions(CLI::App& command, CommonOptions& options);

absl::StatusOr<std::unique_ptr<client::Connection>> Connect(const CommonOptions& options);

// "jobs/7" of "jobs/7" or "7". InvalidArgument if it names something else.
absl::StatusOr<std::string> JobName(const std::string& argument);

// Does `act` to each of these jobs and recordings, until one fails, and prints the names that it was done to; `done` is
// what that is called, as "deleted". Nothing is done when a name is neither jobs/ID nor sequences/ID. Returns the exit
// code.
int ForEachResource(const CommonOptions& options, const std::vector<std::string>& names, const std::string& done,
                    const std::function<absl::Status(client::Connection& connection, const std::string& name)>& act);

// Prints a failure to stderr, for a person to read. Returns the exit code that `status` means.
int Report(const absl::Status& status);

// The exit code of a job that has ended. Prints why when that is not success.
int ReportOutcome(const v1::Job& job);

// A resource in protobuf's JSON mapping, with every field, as the HTTP interface would answer.
nlohmann::json ToJson(const google::protobuf::Message& message);

// One line on stdout, flushed: a script reading a pipe sees it at once.
void PrintJson(const nlohmann::json& json);

// "STATE_RUNNING" -> "RUNNING".
std::string StateName(v1::Job::State state);
std::string StateName(v1::Sequence::State state);

// Text from the server without control characters, which must not reach the terminal.
std::string Printable(std::string text);
// The same for text of several lines.
std::string PrintableLines(std::string text);

// "17 B", "1.4 MB": powers of 1000.
std::string FormatBytes(int64_t bytes);
// "0:07", "1:02:03".
std::string FormatDuration(double seconds);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_COMMON_H_
