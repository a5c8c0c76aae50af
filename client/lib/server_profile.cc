#include "client/lib/server_profile.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace depthtween::client {
namespace {

namespace fs = std::filesystem;

std::optional<std::string> ReadSmallFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  if (!file || !(text << file.rdbuf())) return std::nullopt;
  return text.str();
}

// What is in the file that `flag` names; empty if it names none.
absl::StatusOr<std::string> ReadNamed(absl::string_view flag, const std::string& path) {
  if (path.empty()) return std::string();
  std::optional<std::string> text = ReadSmallFile(path);
  if (!text) return absl::InvalidArgumentError(absl::StrCat(flag, " = ", path, ": cannot be read, or is empty"));
  return *std::move(text);
}

std::string Environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

std::string ServersFile() {
  if (std::string named = Environment("DEPTHTWEEN_CONFIG"); !named.empty()) return named;
  std::string folder = Environment("XDG_CONFIG_HOME");
  if (folder.empty() && !Environment("HOME").empty()) folder = Environment("HOME") + "/.config";
  return folder.empty() ? "" : folder + "/depthtween/servers.json";
}

absl::StatusOr<std::optional<ServerProfile>> FindServer(const std::string& file, std::string_view name) {
  const std::optional<std::string> text = file.empty() ? std::nullopt : ReadSmallFile(file);
  if (!text) return std::nullopt;
  const auto place = [&](const std::string& path) {
    return path.empty() ? path : (fs::path(file).parent_path() / path).string();
  };
  try {
    const nlohmann::json document = nlohmann::json::parse(*text);
    const nlohmann::json& servers = document.at("servers");
    const auto found = servers.find(std::string(name));
    if (found == servers.end()) return std::nullopt;
    ServerProfile profile;
    for (const auto& [key, value] : found->items()) {
      if (key == "address") {
        profile.address = value.get<std::string>();
      } else if (key == "tls") {
        profile.tls = value.get<bool>();
      } else if (key == "tls_ca") {
        profile.tls_ca = place(value.get<std::string>());
      } else if (key == "tls_cert") {
        profile.tls_cert = place(value.get<std::string>());
      } else if (key == "tls_key") {
        profile.tls_key = place(value.get<std::string>());
      } else if (key == "token_file") {
        profile.token_file = place(value.get<std::string>());
      } else {
        return absl::InvalidArgumentError(
            absl::StrCat(file, ": ", key, " of server ", std::string(name),
                         " means nothing; there are address, tls, tls_ca, tls_cert, tls_key, token_file"));
      }
    }
    if (profile.address.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(file, ": server ", std::string(name), " has no address"));
    }
    return profile;
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrCat(file, ": must be {\"servers\": {NAME: {\"address\": ..., ...}}}: ", error.what()));
  }
}

absl::Status Apply(const ServerProfile& profile, ConnectionOptions& options) {
  options.address = profile.address;
  options.tls = profile.tls || !profile.tls_ca.empty() || !profile.tls_cert.empty() || !profile.tls_key.empty();
  if (profile.tls_cert.empty() != profile.tls_key.empty()) {
    return absl::InvalidArgumentError("--tls-cert and --tls-key belong together: name both or neither");
  }
  ASSIGN_OR_RETURN(options.tls_roots, ReadNamed("--tls-ca", profile.tls_ca));
  ASSIGN_OR_RETURN(options.tls_cert, ReadNamed("--tls-cert", profile.tls_cert));
  ASSIGN_OR_RETURN(options.tls_key, ReadNamed("--tls-key", profile.tls_key));
  if (!profile.token_file.empty()) {
    ASSIGN_OR_RETURN(const std::string token, ReadNamed("--token-file", profile.token_file));
    options.token = std::string(absl::StripAsciiWhitespace(token));
    if (options.token.find_first_of(" \t\r\n") != std::string::npos) {
      return absl::InvalidArgumentError(
          absl::StrCat("--token-file = ", profile.token_file, ": must hold the secret alone, which is one word"));
    }
  }
  return absl::OkStatus();
}

bool IsLocalAddress(std::string_view address) {
  const auto starts = [address](std::string_view with) { return address.substr(0, with.size()) == with; };
  return starts("unix:") || starts("127.") || starts("localhost") || starts("[::1]");
}

}  // namespace depthtween::client
