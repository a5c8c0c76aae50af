#include "server/rpc/rpc_server.h"

#include <arpa/inet.h>
#include <grpc/support/log.h>
#include <grpcpp/channel.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/resource_quota.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <chrono>
#include <mutex>
#include <string_view>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "server/rpc/admin_service.h"
#include "server/rpc/call_runtime.h"
#include "server/rpc/health_service.h"
#include "server/rpc/job_service.h"
#include "server/rpc/output_service.h"
#include "server/rpc/sequence_service.h"
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

struct Address {
  std::string host;  // without brackets
  int port = 0;
};

absl::StatusOr<Address> ParseAddress(const std::string& listen) {
  const size_t colon = listen.rfind(':');
  Address address;
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

bool IsLoopback(const std::string& host) {
  if (host == "localhost") return true;
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  in6_addr v6{};
  return inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

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

}  // namespace

absl::Status RpcServerOptions::Validate() const {
  RETURN_IF_ERROR(Positive("call_threads", call_threads));
  RETURN_IF_ERROR(Positive("max_calls", max_calls));
  RETURN_IF_ERROR(Positive("max_streams_per_connection", max_streams_per_connection));
  RETURN_IF_ERROR(Positive("max_message_bytes", max_message_bytes));
  RETURN_IF_ERROR(Positive("transport_memory_bytes", transport_memory_bytes));
  RETURN_IF_ERROR(Positive("frame_memory_bytes", frame_memory_bytes));
  RETURN_IF_ERROR(Positive("watch_heartbeat (ms)", absl::ToInt64Milliseconds(watch_heartbeat)));
  if (listen.rfind("unix:", 0) == 0) return absl::OkStatus();
  ASSIGN_OR_RETURN(const Address address, ParseAddress(listen));
  if (!IsLoopback(address.host) && !insecure_listen_anywhere) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "listen = \"%s\" is reachable from other machines, and this server has neither TLS nor authentication: anyone "
        "who can reach it can read and delete everything. Listen on 127.0.0.1 or [::1], or use "
        "--insecure-listen-anywhere if the network itself keeps others out",
        listen));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<RpcServer>> RpcServer::Start(const RpcServerOptions& options, const Limits& limits,
                                                            const DataDirectory& directory, Sequences& sequences,
                                                            JobManager& jobs, Health& health) {
  RETURN_IF_ERROR(options.Validate());
  static std::once_flag once;
  std::call_once(once, [] {
    gpr_set_log_function(LogFromGrpc);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  });

  std::unique_ptr<RpcServer> result(new RpcServer(health));
  result->runtime_ = std::make_unique<CallRuntime>(directory, options.call_threads, options.max_calls);
  CallRuntime& runtime = *result->runtime_;
  result->services_.push_back(MakeSequenceService(runtime, sequences, jobs, limits));
  result->services_.push_back(MakeJobService(runtime, jobs, limits, options.watch_heartbeat));
  result->services_.push_back(MakeOutputService(runtime, jobs, options.frame_memory_bytes));
  result->services_.push_back(MakeAdminService(runtime, jobs, limits));
  result->services_.push_back(MakeHealthService(runtime, health));

  grpc::ServerBuilder builder;
  for (const auto& service : result->services_) builder.RegisterService(service.get());
  builder.AddListeningPort(options.listen, grpc::InsecureServerCredentials(), &result->port_);
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
  // By default two servers silently share a port, and each gets some of the calls.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  // Only reflection is synchronous; it needs no more.
  builder.SetSyncServerOption(grpc::ServerBuilder::NUM_CQS, 1);
  builder.SetSyncServerOption(grpc::ServerBuilder::MAX_POLLERS, 2);
  result->server_ = builder.BuildAndStart();
  if (result->server_ == nullptr) {
    // gRPC says why only in its log.
    const bool socket = options.listen.rfind("unix:", 0) == 0;
    return absl::FailedPreconditionError(absl::StrFormat(
        "cannot listen on %s: is another server running there? %s", options.listen,
        socket ? "If not, the folder of the socket is missing or not writable"
               : "If not, HOST is not an address of this machine (--listen HOST:0 takes any free port)"));
  }
  for (const char* service : kServiceNames) health.Set(service, true);
  health.Set("", true);
  return result;
}

RpcServer::RpcServer(Health& health) : health_(health) {}

RpcServer::~RpcServer() { Stop(absl::ZeroDuration()); }

std::shared_ptr<grpc::Channel> RpcServer::InProcessChannel() { return server_->InProcessChannel({}); }

void RpcServer::Stop(absl::Duration patience) {
  if (server_ == nullptr) return;
  health_.StopServing();
  runtime_->Stop();
  server_->Shutdown(std::chrono::system_clock::now() + absl::ToChronoMilliseconds(patience));
  server_.reset();
}

}  // namespace depthtween::server
