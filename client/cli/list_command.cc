#include <google/protobuf/util/time_util.h>
#include <nlohmann/json.hpp>

#include <functional>
#include <iostream>
#include <limits>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"
#include "client/cli/job_progress.h"

namespace depthtween::cli {
namespace {

struct ListOptions {
  CommonOptions common;
  bool sequences = false;
  std::string state;
  int limit = 50;
};

void PrintRow(const std::string& name, const std::string& state, const google::protobuf::Timestamp& created,
              const std::string& facts, const std::string& display_name) {
  std::cout << absl::StrFormat("%-26s  %-10s  %-20s  %-44s  %s\n", name, state,
                               google::protobuf::util::TimeUtil::ToString(created).substr(0, 19) + "Z", facts,
                               Printable(display_name));
}

void PrintRow(const v1::Job& job) {
  PrintRow(job.name(), StateName(job.state()), job.create_time(), DescribeProgress(job), job.display_name());
}

void PrintRow(const v1::Sequence& sequence) {
  PrintRow(sequence.name(), StateName(sequence.state()), sequence.create_time(),
           absl::StrCat(sequence.file_count(), " files, ", FormatBytes(sequence.size_bytes())),
           sequence.display_name());
}

// Reads pages until `limit` resources are printed or none is left. `Response` holds them in `items`.
template <typename Request, typename Response, typename Stub, typename Item>
int List(client::Connection& connection, Stub& stub,
         grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
         const google::protobuf::RepeatedPtrField<Item>& (Response::*items)() const, const char* json_name,
         Request request, const ListOptions& options) {
  if (!options.state.empty()) request.set_filter("state = " + options.state);
  nlohmann::json found = nlohmann::json::array();
  int count = 0;
  do {
    request.set_page_size(std::min(options.limit - count, 1000));
    const absl::StatusOr<Response> page = connection.Call(stub, method, request);
    if (!page.ok()) return Report(page.status());
    for (const Item& item : ((*page).*items)()) {
      if (options.common.json) {
        found.push_back(ToJson(item));
      } else {
        PrintRow(item);
      }
      ++count;
    }
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty() && count < options.limit);
  if (options.common.json) PrintJson({{json_name, found}});
  return kExitOk;
}

int List(const ListOptions& options) {
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  if (options.sequences) {
    return List(**connection, (*connection)->sequences(), &v1::SequenceService::StubInterface::ListSequences,
                &v1::ListSequencesResponse::sequences, "sequences", v1::ListSequencesRequest(), options);
  }
  v1::ListJobsRequest request;
  if (options.common.json) request.set_view(v1::JOB_VIEW_FULL);  // a row needs less
  return List(**connection, (*connection)->jobs(), &v1::JobService::StubInterface::ListJobs,
              &v1::ListJobsResponse::jobs, "jobs", request, options);
}

}  // namespace

void AddListCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<ListOptions>();
  CLI::App* command = app.add_subcommand("list", "Show the jobs on the server, newest first");
  command->add_flag("--sequences", options->sequences, "Show the recordings instead");
  command->add_option("--state", options->state, "Only those in this state, such as RUNNING or READY");
  command->add_option("--limit", options->limit, "At most this many")
      ->type_name("N")
      ->check(CLI::Range(1, std::numeric_limits<int>::max()))
      ->capture_default_str();
  AddCommonOptions(*command, options->common);
  command->callback([options, exit_code] { *exit_code = List(*options); });
}

}  // namespace depthtween::cli
