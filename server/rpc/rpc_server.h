// The gRPC server: all services on one port, until it is told to stop.
#ifndef DEPTHTWEEN_SERVER_RPC_RPC_SERVER_H_
#define DEPTHTWEEN_SERVER_RPC_RPC_SERVER_H_

#include <grpcpp/server_builder.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "proto/depthtween/local_address.h"
#include "server/access/guard.h"
#include "server/access/tls_files.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/sequences.h"
#include "server/jobs/upkeep.h"
#include "server/rpc/call_runtime.h"
#include "server/rpc/listener.h"
#include "server/store/data_directory.h"
#include "server/telemetry/health.h"

namespace grpc {
class Channel;
class Server;
class Service;
}  // namespace grpc

namespace depthtween::server {

struct RpcServerOptions {
  std::string listen = LocalListenAddress();  // HOST:PORT, with port 0 any free one, or unix:PATH
  // Without it the server listens where others can reach it only with TLS and tokens, see CheckListenAddress.
  bool insecure_listen_anywhere = false;
  TlsFiles tls;
  int call_threads = 8;  // that answer calls; a call that waits holds none
  CallRoom room;
  int reserved_files = 64;  // file descriptors that connections leave to the rest of the server
  int max_streams_per_connection = 200;
  int max_message_bytes = 4 << 20;
  int64_t transport_memory_bytes = int64_t{512} << 20;  // what gRPC may buffer for all connections together
  int64_t frame_memory_bytes = int64_t{1} << 30;        // what streams of frames may hold together
  absl::Duration watch_heartbeat = absl::Seconds(15);

  // `tokens`: the guard asks for them.
  absl::Status Validate(bool tokens) const;
};

class RpcServer {
 public:
  // Binds the port and starts to serve. Borrows all but the options; they must outlive it.
  // InvalidArgument for options and TLS files that cannot be used; FailedPrecondition if the address cannot be bound.
  static absl::StatusOr<std::unique_ptr<RpcServer>> Start(const RpcServerOptions& options,
                                                          const DataDirectory& directory, Guard& guard,
                                                          Sequences& sequences, JobManager& jobs, Upkeep& upkeep,
                                                          Health& health);
  // Stops without patience, unless Stop was called.
  ~RpcServer();
  RpcServer(const RpcServer&) = delete;
  RpcServer& operator=(const RpcServer&) = delete;

  // The bound port; 0 for a unix: socket.
  int port() const { return port_; }
  // A channel to this server that needs no network.
  std::shared_ptr<grpc::Channel> InProcessChannel();

  // Health says NOT_SERVING, new calls are refused, streams end with UNAVAILABLE and a RetryInfo. Returns when no call
  // is left, or after `patience`.
  void Drain(absl::Duration patience);
  // Drains, and cancels what is left after `patience`. Afterwards no call may begin on a channel within the process:
  // gRPC 1.51 would read what it has freed. Who calls over one is stopped between Drain and Stop.
  void Stop(absl::Duration patience);

 private:
  explicit RpcServer(Health& health);

  Health& health_;
  int port_ = 0;
  std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor_;
  std::vector<std::unique_ptr<grpc::Service>> services_;
  std::unique_ptr<CallRuntime> runtime_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<Listener> listener_;  // ends before the server that it feeds
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_RPC_SERVER_H_
