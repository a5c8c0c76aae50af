#include "server/rpc/health_check.h"

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <chrono>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "grpc/health/v1/health.grpc.pb.h"

namespace depthtween::server {

namespace {

absl::StatusOr<std::string> ReadPem(const char* flag, const std::string& file) {
  if (file.empty()) return std::string();
  absl::StatusOr<std::string> text = ReadFile(file);
  if (!text.ok()) return absl::InvalidArgumentError(absl::StrCat(flag, ": ", text.status().message()));
  return text;
}

}  // namespace

absl::Status CheckHealth(const HealthCheckOptions& options) {
  grpc::SslCredentialsOptions tls;
  ASSIGN_OR_RETURN(tls.pem_root_certs, ReadPem("--tls-ca", options.tls_ca));
  ASSIGN_OR_RETURN(tls.pem_cert_chain, ReadPem("--tls-cert", options.tls_cert));
  ASSIGN_OR_RETURN(tls.pem_private_key, ReadPem("--tls-key", options.tls_key));
  if (options.tls_ca.empty() && !(options.tls_cert.empty() && options.tls_key.empty() && options.tls_name.empty())) {
    return absl::InvalidArgumentError("--tls-cert, --tls-key and --tls-name need --tls-ca");
  }
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);  // a probe asks this server, not the site's proxy about it
  if (!options.tls_name.empty()) arguments.SetSslTargetNameOverride(options.tls_name);
  const std::string& address = options.server;
  const auto credentials = options.tls_ca.empty() ? grpc::InsecureChannelCredentials() : grpc::SslCredentials(tls);
  const auto channel = grpc::CreateCustomChannel(address, credentials, arguments);
  const auto stub = grpc::health::v1::Health::NewStub(channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + absl::ToChronoMilliseconds(options.timeout));
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
