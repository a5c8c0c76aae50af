// Where a listener listens, and what that takes: one rule for gRPC and HTTP.
#ifndef DEPTHTWEEN_SERVER_ACCESS_LISTEN_ADDRESS_H_
#define DEPTHTWEEN_SERVER_ACCESS_LISTEN_ADDRESS_H_

#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

struct ListenAddress {
  std::string host;  // without brackets
  int port = 0;      // 0: any free one
};

// "127.0.0.1:50051", "[::1]:0", "localhost:80". InvalidArgument otherwise.
absl::StatusOr<ListenAddress> ParseListenAddress(const std::string& listen);
bool IsUnixSocket(std::string_view listen);  // "unix:PATH"
// Only this machine can reach it.
bool IsLoopback(const std::string& host);

// How a listener is protected.
struct Protection {
  bool tls = false;
  bool tokens = false;
  bool insecure_anywhere = false;  // the operator has said that the network keeps others out
};
// OK if `listen` may be listened on: a unix: socket or a loopback address always; any other with TLS and tokens, or
// where the operator has said so. InvalidArgument for no address, and for one that would let strangers in.
absl::Status CheckListenAddress(const std::string& listen, const Protection& protection);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_ACCESS_LISTEN_ADDRESS_H_
