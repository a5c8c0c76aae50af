// How to reach a server: its address, TLS, a token. Named ones stand in a file, so that a short name is enough.
#ifndef DEPTHTWEEN_CLIENT_LIB_SERVER_PROFILE_H_
#define DEPTHTWEEN_CLIENT_LIB_SERVER_PROFILE_H_

#include <optional>
#include <string>
#include <string_view>

#include "client/lib/connection.h"

namespace depthtween::client {

struct ServerProfile {
  std::string address;
  bool tls = false;        // also meant by any of the next three
  std::string tls_ca;      // PEM file: who may have signed the server's certificate; empty: the system's authorities
  std::string tls_cert;    // PEM file: our own certificate, where the server asks for one
  std::string tls_key;     // PEM file: its key
  std::string token_file;  // holds the secret, alone
};

// The profile of that name in a file of named servers, which is JSON:
//   {"servers": {"studio": {"address": "depth.example.org:443", "tls": true, "token_file": "studio.token"}}}
// Its files are relative to the folder it lies in. nullopt if there is no file or no such name in it; InvalidArgument
// if the file cannot be understood.
absl::StatusOr<std::optional<ServerProfile>> FindServer(const std::string& file, std::string_view name);
// Where that file lies: DEPTHTWEEN_CONFIG, else depthtween/servers.json in XDG_CONFIG_HOME or ~/.config. Empty if none
// of them is set.
std::string ServersFile();

// Reads the profile's files into `options`. InvalidArgument names the file that cannot be read or is empty, or what is
// missing.
absl::Status Apply(const ServerProfile& profile, ConnectionOptions& options);

// The address is this machine's own: what is sent there crosses no network.
bool IsLocalAddress(std::string_view address);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_SERVER_PROFILE_H_
