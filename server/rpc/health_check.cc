#include "server/rpc/health_check.h"

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <chrono>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "grpc/health/v1/health.grpc.pb.h"

namespace depthtween::server {

absl::Status CheckHealth(const std::string& address, const std::string& tls_ca, absl::Duration timeout) {
  std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::InsecureChannelCredentials();
  if (!tls_ca.empty()) {
    const absl::StatusOr<std::string> roots = ReadFile(tls_ca);
    if (!roots.ok()) return absl::InvalidArgumentError(absl::StrCat("--tls-ca: ", roots.status().message()));
    credentials = grpc::SslCredentials({.pem_root_certs = *roots, .pem_private_key = {}, .pem_cert_chain = {}});
  }
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);  // a probe asks this server, not the site's proxy about it
  const auto channel = grpc::CreateCustomChannel(address, credentials, arguments);
  const auto stub = grpc::health::v1::Health::NewStub(channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + absl::ToChronoMilliseconds(timeout));
  grpc::health::v1::HealthCheckResponse response;
  const grpc::Status status = stub->Check(&context, {}, &response);
  if (!status.ok()) {
    return absl::UnavailableError(absl::StrFormat("%s does not answer: %s", address, status.error_message()));
  }
  if (response.status() != grpc::health::v1::HealthCheckResponse::SERVING) {
    return absl::UnavailableError(absl::StrFormat(
        "%s says %s", address, grpc::health::v1::HealthCheckResponse::ServingStatus_Name(response.status())));
  }
  return absl::OkStatus();
}

}  // namespace depthtween::server
