// Asks a server for its health, from outside: what probes and the image's health check run.
#ifndef DEPTHTWEEN_SERVER_RPC_HEALTH_CHECK_H_
#define DEPTHTWEEN_SERVER_RPC_HEALTH_CHECK_H_

#include <string>

#include "absl/time/time.h"
#include "core/base/status.h"

namespace depthtween::server {

// OK if the server at `address` says SERVING within `timeout`; Unavailable with what it said otherwise. With `tls_ca`,
// a PEM file, over TLS. InvalidArgument if that file cannot be read.
absl::Status CheckHealth(const std::string& address, const std::string& tls_ca, absl::Duration timeout);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_HEALTH_CHECK_H_
