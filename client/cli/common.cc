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

namespace {

// The server that the options name: flags and environment win over what its file says.
absl::StatusOr<client::ServerProfile> ProfileOf(const CommonOptions& options) {
  ASSIGN_OR_RETURN(const std::optional<client::ServerProfile> named,
                   client::FindServer(client::ServersFile(), options.server));
  client::ServerProfile profile = named.value_or(client::ServerProfile{.address = options.server});
  profile.tls = profile.tls || options.profile.tls;
  const auto prefer = [](const std::string& said, std::string& value) {
    if (!said.empty()) value = said;
  };
  prefer(options.profile.tls_ca, profile.tls_ca);
  prefer(options.profile.tls_cert, profile.tls_cert);
  prefer(options.profile.tls_key, profile.tls_key);
  prefer(options.profile.token_file, profile.token_file);
  return profile;
}

}  // namespace

void AddCommonOptions(CLI::App& command, CommonOptions& options) {
  command
      .add_option("--server", options.server,
                  "Address of the server, host:port, or a name of the file of servers (see 'depthtween --help'). By "
                  "default the "
                  "socket of your own server in XDG_RUNTIME_DIR, if there is one")
      ->envname("DEPTHTWEEN_SERVER")
      ->type_name("ADDRESS")
      ->check(client::AddressProblem)
      ->capture_default_str();
  const std::string access = "Access";
  command.add_flag("--tls", options.profile.tls, "The server speaks TLS, with a certificate that this system trusts")
      ->group(access);
  const auto file = [&](const char* flag, const char* environment, std::string& value, const char* help) {
    command.add_option(flag, value, help)->envname(environment)->type_name("FILE")->group(access);
  };
  file("--tls-ca", "DEPTHTWEEN_TLS_CA", options.profile.tls_ca,
       "The server speaks TLS, with a certificate that one of these has signed (PEM)");
  file("--tls-cert", "DEPTHTWEEN_TLS_CERT", options.profile.tls_cert,
       "Your own certificate, where the server asks for one (PEM)");
  file("--tls-key", "DEPTHTWEEN_TLS_KEY", options.profile.tls_key, "Its private key (PEM)");
  file("--token-file", "DEPTHTWEEN_TOKEN_FILE", options.profile.token_file,
       "Holds the secret of your token, where the server asks for one");
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
  client::ConnectionOptions connection = {.patience = std::chrono::milliseconds(std::lround(options.patience_s * 1000)),
                                          .on_away = on_away};
  ASSIGN_OR_RETURN(const client::ServerProfile profile, ProfileOf(options));
  RETURN_IF_ERROR(client::Apply(profile, connection));
  if (!connection.token.empty() && !connection.tls && !client::IsLocalAddress(connection.address)) {
    std::cerr << "depthtween: warning: the token crosses the network in the clear, because " << connection.address
              << " is called without TLS (--tls, --tls-ca)" << std::endl;
  }
  return client::Connection::Open(connection);
}

absl::StatusOr<std::string> JobName(const std::string& argument) {
  const absl::string_view id = absl::StripPrefix(argument, "jobs/");
  if (id.empty() || absl::StrContains(id, '/')) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "'%s' is not the name of a job: it must be jobs/ID ('depthtween list' shows the jobs)", argument));
  }
  return absl::StrCat("jobs/", id);
}

int ForEachResource(const CommonOptions& options, const std::vector<std::string>& names, const std::string& done,
                    const std::function<absl::Status(client::Connection& connection, const std::string& name)>& act) {
  for (const std::string& name : names) {
    if (absl::StartsWith(name, "jobs/") || absl::StartsWith(name, "sequences/")) continue;
    std::cerr << "depthtween: '" << name << "' is neither jobs/ID nor sequences/ID; nothing was " << done << std::endl;
    return kExitUsage;
  }
  const auto connection = Connect(options);
  if (!connection.ok()) return Report(connection.status());
  nlohmann::json json = nlohmann::json::array();
  int exit_code = kExitOk;
  for (const std::string& name : names) {
    if (const absl::Status status = act(**connection, name); !status.ok()) {
      exit_code = Report(status);
      break;
    }
    json.push_back(name);
    if (!options.json) std::cout << name << std::endl;
  }
  if (options.json) PrintJson({{done, json}});
  return exit_code;
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
