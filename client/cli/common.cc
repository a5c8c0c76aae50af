#include "client/cli/common.h"

#include <google/protobuf/util/json_util.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <iostream>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/cli/exit_codes.h"
#include "client/lib/jobs.h"

namespace depthtween::cli {

void AddCommonOptions(CLI::App& command, CommonOptions& options) {
  command.add_option("--server", options.server, "Address of the server, host:port")
      ->envname("DEPTHTWEEN_SERVER")
      ->type_name("ADDRESS")
      ->check(client::AddressProblem)
      ->capture_default_str();
  command
      .add_option(
          "--patience", options.patience_s,
          "Keep trying for this long while the server does not answer, because it is starting, restarting or cut "
          "off. 0: give up at once")
      ->type_name("SECONDS")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  command.add_flag("--json", options.json, "Print the result as JSON on stdout");
}

absl::StatusOr<std::unique_ptr<client::Connection>> Connect(const CommonOptions& options) {
  const auto on_away = [options](const absl::Status& why) {
    const std::string what =
        absl::IsUnavailable(why) ? absl::StrCat("no server answers at ", options.server) : std::string(why.message());
    if (isatty(STDERR_FILENO) == 1) std::cerr << "\r\x1b[K";  // erases a progress line
    std::cerr << "depthtween: " << what << "; trying again for up to " << options.patience_s << " s (--patience)"
              << std::endl;
  };
  return client::Connection::Open({.address = options.server,
                                   .patience = std::chrono::milliseconds(std::lround(options.patience_s * 1000)),
                                   .on_away = on_away});
}

absl::StatusOr<std::string> JobName(const std::string& argument) {
  const absl::string_view id = absl::StripPrefix(argument, "jobs/");
  if (id.empty() || absl::StrContains(id, '/')) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "'%s' is not the name of a job: it must be jobs/ID ('depthtween list' shows the jobs)", argument));
  }
  return absl::StrCat("jobs/", id);
}

int Report(const absl::Status& status) {
  if (status.ok()) return kExitOk;
  std::cerr << "depthtween: " << PrintableLines(std::string(status.message())) << std::endl;
  return absl::IsUnavailable(status) ? kExitUnreachable : kExitFailed;
}

int ReportOutcome(const v1::Job& job) {
  const absl::Status outcome = client::Outcome(job);
  switch (job.state()) {
    case v1::Job::STATE_SUCCEEDED:
      return kExitOk;
    case v1::Job::STATE_FAILED:
      std::cerr << "depthtween: " << job.name() << " failed: " << PrintableLines(std::string(outcome.message())) << " ("
                << absl::StatusCodeToString(outcome.code()) << ")" << std::endl;
      return kExitJobFailed;
    case v1::Job::STATE_CANCELLED:
      std::cerr << "depthtween: " << outcome.message() << std::endl;
      return kExitJobCancelled;
    default:
      std::cerr << "depthtween: " << outcome.message() << std::endl;
      return kExitNotFinished;
  }
}

nlohmann::json ToJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  std::string text;
  if (!google::protobuf::util::MessageToJsonString(message, &text, options).ok()) return nullptr;
  return nlohmann::json::parse(text);
}

void PrintJson(const nlohmann::json& json) { std::cout << json.dump() << std::endl; }

std::string StateName(v1::Job::State state) {
  return std::string(absl::StripPrefix(v1::Job::State_Name(state), "STATE_"));
}

std::string StateName(v1::Sequence::State state) {
  return std::string(absl::StripPrefix(v1::Sequence::State_Name(state), "STATE_"));
}

std::string Printable(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return text;
}

std::string PrintableLines(std::string text) {
  for (char& c : text) {
    if ((static_cast<unsigned char>(c) < 0x20 && c != '\n') || c == 0x7f) c = '?';
  }
  return text;
}

std::string FormatBytes(int64_t bytes) {
  constexpr const char* kUnits[] = {"kB", "MB", "GB", "TB"};
  if (bytes < 1000) return absl::StrCat(bytes, " B");
  double value = static_cast<double>(bytes) / 1000;
  size_t unit = 0;
  for (; value >= 999.95 && unit + 1 < std::size(kUnits); ++unit) value /= 1000;
  return absl::StrFormat("%.1f %s", value, kUnits[unit]);
}

std::string FormatDuration(double seconds) {
  const int64_t whole = std::llround(std::max(0.0, seconds));
  if (whole < 3600) return absl::StrFormat("%d:%02d", whole / 60, whole % 60);
  return absl::StrFormat("%d:%02d:%02d", whole / 3600, whole / 60 % 60, whole % 60);
}

}  // namespace depthtween::cli
