#include "server/rpc/rpc_server.h"

#include <grpc/support/log.h>
#include <grpcpp/channel.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/resource_quota.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <mutex>
#include <string_view>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "server/access/listen_address.h"
#include "server/rpc/admin_service.h"
#include "server/rpc/call_runtime.h"
#include "server/rpc/health_service.h"
#include "server/rpc/job_service.h"
#include "server/rpc/output_service.h"
#include "server/rpc/sequence_service.h"
#include "server/rpc/undecodable.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

// The services whose health is told one by one.
constexpr const char* kServiceNames[] = {"depthtween.v1.SequenceService", "depthtween.v1.JobService",
                                         "depthtween.v1.OutputService", "depthtween.v1.AdminService"};

// A peer that does not answer a ping for this long is gone; its streams end.
constexpr int kPingEveryMs = 20'000;
constexpr int kPingTimeoutMs = 10'000;
// Clients may ping too, not more often than this.
constexpr int kClientPingEveryMs = 5'000;
// A connection is renewed after this long, so that none is kept for ever; calls that are under way go on on the old
// one.
constexpr int kConnectionAgeMs = 30 * 60'000;
// So that connections of nobody cost no descriptor for long: those that say nothing, and those without a call.
constexpr int kHandshakeTimeoutMs = 20'000;
constexpr int kConnectionIdleMs = 10 * 60'000;
constexpr unsigned kCertificateLookSeconds = 1;

// Writes gRPC's own messages to our log, in the same form.
void LogFromGrpc(gpr_log_func_args* arguments) {
  const LogLevel level = arguments->severity == GPR_LOG_SEVERITY_ERROR  ? LogLevel::kWarning
                         : arguments->severity == GPR_LOG_SEVERITY_INFO ? LogLevel::kInfo
                                                                        : LogLevel::kDebug;
  Log(level, "grpc",
      {{"source", absl::StrCat(arguments->file, ":", arguments->line)}, {"message", arguments->message}});
}

absl::Status Positive(std::string_view field, int64_t value) {
  if (value > 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s = %d, must be > 0", std::string(field), value));
}

// gRPC reads the files again by itself; a broken new one leaves the old one in use.
std::shared_ptr<grpc::ServerCredentials> ServerCredentials(const TlsFiles& tls) {
  if (!tls.enabled()) return grpc::InsecureServerCredentials();
  const auto provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      tls.key, tls.cert, tls.client_ca, kCertificateLookSeconds);
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_identity_key_cert_pairs();
  if (!tls.client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return grpc::experimental::TlsServerCredentials(options);
}

}  // namespace

absl::Status RpcServerOptions::Validate(bool tokens) const {
  RETURN_IF_ERROR(Positive("call_threads", call_threads));
  RETURN_IF_ERROR(Positive("max_calls", room.calls));
  RETURN_IF_ERROR(Positive("max_streams", room.streams));
  RETURN_IF_ERROR(Positive("max_streams_of_client", room.streams_of_client));
  RETURN_IF_ERROR(Positive("health calls", room.health));
  RETURN_IF_ERROR(Positive("max_streams_per_connection", max_streams_per_connection));
  RETURN_IF_ERROR(Positive("max_message_bytes", max_message_bytes));
  RETURN_IF_ERROR(Positive("transport_memory_bytes", transport_memory_bytes));
  RETURN_IF_ERROR(Positive("frame_memory_bytes", frame_memory_bytes));
  RETURN_IF_ERROR(Positive("watch_heartbeat (ms)", absl::ToInt64Milliseconds(watch_heartbeat)));
  RETURN_IF_ERROR(CheckListenAddress(
      listen, {.tls = tls.enabled(), .tokens = tokens, .insecure_anywhere = insecure_listen_anywhere}));
  return tls.enabled() ? CheckTlsFiles(tls) : absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<RpcServer>> RpcServer::Start(const RpcServerOptions& options,
                                                            const DataDirectory& directory, Guard& guard,
                                                            Sequences& sequences, JobManager& jobs, Upkeep& upkeep,
                                                            Health& health) {
  LiveLimits& limits = sequences.limits();
  RETURN_IF_ERROR(options.Validate(guard.asks_for_tokens()));
  static std::once_flag once;
  std::call_once(once, [] {
    gpr_set_log_function(LogFromGrpc);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  });

  std::unique_ptr<RpcServer> result(new RpcServer(health));
  result->runtime_ = std::make_unique<CallRuntime>(directory, guard, options.call_threads, options.room);
  CallRuntime& runtime = *result->runtime_;
  result->services_.push_back(MakeSequenceService(runtime, sequences, jobs, limits));
  result->services_.push_back(MakeJobService(runtime, jobs, limits, options.watch_heartbeat));
  result->services_.push_back(MakeOutputService(runtime, jobs, guard, options.frame_memory_bytes));
  result->services_.push_back(MakeAdminService(runtime, jobs, upkeep, guard, limits, health));
  result->services_.push_back(MakeHealthService(runtime, health));

  ASSIGN_OR_RETURN(result->listener_, Listener::Bind(options.listen));
  result->port_ = result->listener_->port();
  grpc::ServerBuilder builder;
  for (const auto& service : result->services_) builder.RegisterService(service.get());
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> interceptors;
  interceptors.push_back(MakeUndecodableAnswers(runtime));
  builder.experimental().SetInterceptorCreators(std::move(interceptors));
  using Builder = grpc::ServerBuilder::experimental_type;
  result->acceptor_ = builder.experimental().AddExternalConnectionAcceptor(Builder::ExternalConnectionType::FROM_FD,
                                                                           ServerCredentials(options.tls));
  builder.SetMaxReceiveMessageSize(options.max_message_bytes);
  grpc::ResourceQuota quota("depthtween");
  quota.Resize(options.transport_memory_bytes);
  builder.SetResourceQuota(quota);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, options.max_streams_per_connection);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kPingEveryMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kPingTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // no bound: idle streams are pinged too
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kClientPingEveryMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, kConnectionAgeMs);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, kHandshakeTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, kConnectionIdleMs);
  // Only reflection is synchronous; it needs no more.
  builder.SetSyncServerOption(grpc::ServerBuilder::NUM_CQS, 1);
  builder.SetSyncServerOption(grpc::ServerBuilder::MAX_POLLERS, 2);
  result->server_ = builder.BuildAndStart();
  if (result->server_ == nullptr) return absl::InternalError("gRPC cannot serve; its log says why");
  for (const char* service : kServiceNames) health.Set(service, true);
  health.Set("", true);
  const auto hand_over = [acceptor = result->acceptor_.get()](int listener, int connection) {
    grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters parameters;
    parameters.listener_fd = listener;
    parameters.fd = connection;
    acceptor->HandleNewConnection(&parameters);
  };
  result->listener_->Start(options.reserved_files, hand_over);
  return result;
}

RpcServer::RpcServer(Health& health) : health_(health) {}

RpcServer::~RpcServer() { Stop(absl::ZeroDuration()); }

std::shared_ptr<grpc::Channel> RpcServer::InProcessChannel() { return server_->InProcessChannel({}); }

void RpcServer::Drain(absl::Duration patience) {
  health_.StopServing();
  runtime_->Stop();
  runtime_->WaitUntilIdle(absl::Now() + patience);
}

void RpcServer::Stop(absl::Duration patience) {
  if (server_ == nullptr) return;
  const absl::Time deadline = absl::Now() + patience;
  Drain(patience);
  listener_.reset();
  server_->Shutdown(absl::ToChronoTime(deadline));
  server_.reset();
}

}  // namespace depthtween::server
