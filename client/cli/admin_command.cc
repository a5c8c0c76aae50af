#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/time_util.h>

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"

namespace depthtween::cli {
namespace {

using Admin = v1::AdminService::StubInterface;
using google::protobuf::util::TimeUtil;

struct AdminOptions {
  CommonOptions common;
  std::vector<std::string> changes;  // NAME=VALUE
  bool dry_run = false;
  bool resume = false;
  bool start = false;
};

std::string When(const google::protobuf::Timestamp& time) { return TimeUtil::ToString(time).substr(0, 19) + "Z"; }

// One call, and `print` for its answer unless JSON is wanted.
template <typename Request, typename Response, typename Print>
int Ask(const AdminOptions& options, grpc::Status (Admin::*method)(grpc::ClientContext*, const Request&, Response*),
        const Request& request, const Print& print) {
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  const absl::StatusOr<Response> response = (*connection)->Call((*connection)->admin(), method, request);
  if (!response.ok()) return Report(response.status());
  if (options.common.json) {
    PrintJson(ToJson(*response));
  } else {
    print(*response);
  }
  return kExitOk;
}

void PrintLimits(const v1::Limits& limits) {
  const nlohmann::json values = ToJson(limits);
  const google::protobuf::Descriptor* descriptor = v1::Limits::descriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const auto value = values.find(descriptor->field(i)->json_name());
    if (value == values.end()) continue;
    std::cout << absl::StrFormat("%-24s  %s\n", std::string(descriptor->field(i)->name()),
                                 value->is_string() ? value->get<std::string>() : value->dump());
  }
  std::cout << std::flush;
}

// "max_queued_jobs=10" -> the field of that name. InvalidArgument names the limits that there are.
absl::StatusOr<v1::Limits> ParseLimits(const std::vector<std::string>& changes) {
  const google::protobuf::Descriptor* descriptor = v1::Limits::descriptor();
  nlohmann::json wanted = nlohmann::json::object();
  for (const std::string& change : changes) {
    const std::vector<std::string> parts = absl::StrSplit(change, absl::MaxSplits('=', 1));
    const std::string name = absl::StrReplaceAll(parts[0], {{"-", "_"}});
    if (parts.size() != 2 || descriptor->FindFieldByName(name) == nullptr) {
      std::string known;
      for (int i = 0; i < descriptor->field_count(); ++i) {
        absl::StrAppend(&known, i == 0 ? "" : ", ", std::string(descriptor->field(i)->name()));
      }
      return absl::InvalidArgumentError(
          absl::StrCat("'", change, "' is not NAME=VALUE with a limit of the server; they are: ", known));
    }
    wanted[name] = parts[1];
  }
  v1::Limits limits;
  // Protobuf's JSON takes numbers as strings too, and checks that they are numbers in range.
  const auto parsed = google::protobuf::util::JsonStringToMessage(wanted.dump(), &limits);
  if (!parsed.ok()) return absl::InvalidArgumentError(std::string(parsed.message()));
  return limits;
}

int Limits(const AdminOptions& options) {
  if (options.changes.empty()) return Ask(options, &Admin::GetLimits, v1::GetLimitsRequest(), PrintLimits);
  const absl::StatusOr<v1::Limits> limits = ParseLimits(options.changes);
  if (!limits.ok()) {
    Report(limits.status());
    return kExitUsage;
  }
  v1::UpdateLimitsRequest request;
  *request.mutable_limits() = *limits;
  return Ask(options, &Admin::UpdateLimits, request, PrintLimits);
}

int Workers(const AdminOptions& options) {
  return Ask(options, &Admin::ListWorkers, v1::ListWorkersRequest(), [](const v1::ListWorkersResponse& response) {
    for (const v1::Worker& worker : response.workers()) {
      std::string work = worker.kind();
      if (worker.interval_count() > 0) {
        absl::StrAppend(&work, " ", worker.first_interval(), " to ",
                        worker.first_interval() + worker.interval_count() - 1);
      }
      if (worker.failures() > 0) absl::StrAppend(&work, ", try ", worker.failures() + 1);
      std::cout << absl::StrFormat("task %-8d  %-32s  %-26s  %-16s  since %s\n", worker.task(), work, worker.resource(),
                                   Printable(worker.tenant()), When(worker.start_time()));
    }
    std::cout << response.idle_workers() << " workers are idle" << std::endl;
  });
}

void PrintDrain(const v1::DrainState& state) {
  if (!state.draining()) {
    std::cout << "work begins again" << std::endl;
  } else if (state.running_tasks() > 0) {
    std::cout << "draining: " << state.running_tasks() << " tasks still run, nothing new begins" << std::endl;
  } else {
    std::cout << "drained: no task runs, nothing new begins" << std::endl;
  }
}

int Drain(const AdminOptions& options) {
  if (options.resume) return Ask(options, &Admin::Resume, v1::ResumeRequest(), PrintDrain);
  return Ask(options, &Admin::Drain, v1::DrainRequest(), PrintDrain);
}

int Collect(const AdminOptions& options) {
  v1::CollectGarbageRequest request;
  request.set_dry_run(options.dry_run);
  return Ask(options, &Admin::CollectGarbage, request, [&](const v1::CollectGarbageResponse& response) {
    for (const v1::Collected& one : response.collected()) {
      const std::string reason = absl::AsciiStrToLower(
          absl::StrReplaceAll(absl::StripPrefix(v1::Collected::Reason_Name(one.reason()), "REASON_"), {{"_", " "}}));
      std::cout << absl::StrFormat("%-26s  %-16s  %-14s  %10s  since %s\n", one.resource(), Printable(one.tenant()),
                                   reason, FormatBytes(one.size_bytes()), When(one.since()));
    }
    std::cout << response.collected_size() << (options.dry_run ? " would be deleted, " : " deleted, ")
              << FormatBytes(response.size_bytes()) << std::endl;
  });
}

void PrintScrub(const v1::Scrub& scrub) {
  if (!scrub.has_start_time()) {
    std::cout << "no round of reading the stored files has begun yet";
  } else {
    std::cout << (scrub.running() ? "a round runs" : "the last round ran") << " since " << When(scrub.start_time())
              << ", " << scrub.files_checked() << " files read";
  }
  std::cout << "; " << scrub.damaged_files() << " damaged files found since the server started"
            << (scrub.damaged_files() > 0 ? ", its log names them" : "") << std::endl;
}

int Scrub(const AdminOptions& options) {
  if (options.start) return Ask(options, &Admin::StartScrub, v1::StartScrubRequest(), PrintScrub);
  return Ask(options, &Admin::GetScrub, v1::GetScrubRequest(), PrintScrub);
}

}  // namespace

void AddAdminCommand(CLI::App& app, int* exit_code) {
  CLI::App* admin = app.add_subcommand("admin", "What the operator of a server may ask and tell it");
  admin->require_subcommand(1);
  const auto add = [&](const char* name, const char* help, int (*run)(const AdminOptions&)) {
    const auto options = std::make_shared<AdminOptions>();
    CLI::App* command = admin->add_subcommand(name, help);
    AddCommonOptions(*command, options->common);
    command->callback([options, run, exit_code] { *exit_code = run(*options); });
    return std::pair(command, options);
  };
  const auto [limits, limits_options] =
      add("limits", "Show the limits, or change some until the server stops: max_queued_jobs=10", Limits);
  limits->add_option("change", limits_options->changes, "NAME=VALUE of a limit to change")->type_name("CHANGE");
  add("workers", "Show what each worker does", Workers);
  const auto [drain, drain_options] =
      add("drain", "Let running tasks end and begin nothing new; ask again to see whether they have", Drain);
  drain->add_flag("--resume", drain_options->resume, "Begin work again");
  const auto [collect, collect_options] =
      add("collect", "Delete now what the server's rules of retention let it delete", Collect);
  collect->add_flag("--dry-run", collect_options->dry_run, "Only show what would be deleted");
  const auto [scrub, scrub_options] = add("scrub", "Show how far the server is with reading its stored files", Scrub);
  scrub->add_flag("--start", scrub_options->start, "Begin a round now");
}

}  // namespace depthtween::cli
