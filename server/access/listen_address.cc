#include "server/access/listen_address.h"

#include <arpa/inet.h>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"

namespace depthtween::server {

absl::StatusOr<ListenAddress> ParseListenAddress(const std::string& listen) {
  const size_t colon = listen.rfind(':');
  ListenAddress address;
  if (colon == std::string::npos || colon == 0 || !absl::SimpleAtoi(listen.substr(colon + 1), &address.port) ||
      address.port < 0 || address.port > 65535) {
    return absl::InvalidArgumentError(
        absl::StrFormat("listen = \"%s\", must be HOST:PORT such as 127.0.0.1:50051 or [::1]:0, or unix:PATH", listen));
  }
  address.host = listen.substr(0, colon);
  if (address.host.size() >= 2 && address.host.front() == '[' && address.host.back() == ']') {
    address.host = address.host.substr(1, address.host.size() - 2);
  }
  return address;
}

bool IsUnixSocket(std::string_view listen) { return listen.substr(0, 5) == "unix:"; }

bool IsLoopback(const std::string& host) {
  if (host == "localhost") return true;
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  in6_addr v6{};
  return inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

absl::Status CheckListenAddress(const std::string& listen, const Protection& protection) {
  if (IsUnixSocket(listen)) return absl::OkStatus();
  ASSIGN_OR_RETURN(const ListenAddress address, ParseListenAddress(listen));
  if (IsLoopback(address.host) || protection.insecure_anywhere) return absl::OkStatus();
  if (protection.tls && protection.tokens) return absl::OkStatus();
  const char* missing = protection.tls ? "without --tokens anyone who can reach it can read and delete everything"
                        : protection.tokens
                            ? "without --tls-cert and --tls-key its tokens cross the network in the clear"
                            : "without --tls-cert, --tls-key and --tokens anyone who can reach it can "
                              "read and delete everything";
  return absl::InvalidArgumentError(absl::StrFormat(
      "listen = \"%s\" is reachable from other machines, and %s. Add what is missing, listen on 127.0.0.1 or [::1], or "
      "use --insecure-listen-anywhere if the network itself keeps others out",
      listen, missing));
}

}  // namespace depthtween::server
