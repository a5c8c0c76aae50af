// Asks a server for its health, from outside: what probes and the image's health check run.
#ifndef DEPTHTWEEN_SERVER_RPC_HEALTH_CHECK_H_
#define DEPTHTWEEN_SERVER_RPC_HEALTH_CHECK_H_

#include <string>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "proto/depthtween/local_address.h"

namespace depthtween::server {

struct HealthCheckOptions {
  std::string server = LocalServerAddress();  // HOST:PORT or unix:PATH
  // PEM files. With the first over TLS; the others are our own certificate, for a server that asks for one.
  std::string tls_ca, tls_cert, tls_key;
  std::string tls_name;  // what the server's certificate says, where that is not the host of `server`; empty: it is
  absl::Duration timeout = absl::Seconds(3);
};

// OK if the server says SERVING in time; Unavailable with what it said otherwise. InvalidArgument if a file cannot be
// read.
absl::Status CheckHealth(const HealthCheckOptions& options);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_HEALTH_CHECK_H_
