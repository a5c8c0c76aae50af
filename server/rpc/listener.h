// Accepts the connections of the gRPC server, as long as there are file descriptors for them.
//
// gRPC 1.51 does not bound its connections, and once its own listener finds no descriptor for one it accepts nobody any
// more. This one leaves some to the rest of the server, waits while there are no others, and goes on when there are.
#ifndef DEPTHTWEEN_SERVER_RPC_LISTENER_H_
#define DEPTHTWEEN_SERVER_RPC_LISTENER_H_

#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "core/base/descriptor.h"
#include "core/base/status.h"

namespace depthtween::server {

class Listener {
 public:
  // Binds HOST:PORT, with port 0 any free one, or unix:PATH. All addresses of a name are bound. FailedPrecondition if
  // that cannot be, or if a server answers at the socket; what is left there of one that was killed goes.
  static absl::StatusOr<std::unique_ptr<Listener>> Bind(const std::string& listen);
  // Accepts nobody any more. Waits for an `on_connection` that is being called.
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  int port() const { return port_; }  // 0 for a socket of the file system

  // Begins to accept. `on_connection` gets each connection, whose descriptor is the callee's to close; it is called
  // from one thread. So many descriptors as `reserve` are left to others. Call it once.
  void Start(int reserve, std::function<void(int listener, int connection)> on_connection);

 private:
  Listener() = default;
  absl::Status BindSocket(const std::string& listen);
  absl::Status BindPort(const std::string& listen);
  absl::Status Listen(const std::string& listen, int family, const void* address, size_t size);
  void Accept(int reserve, const std::function<void(int listener, int connection)>& on_connection) const;

  std::deque<Descriptor> sockets_;
  std::deque<Descriptor> over_;  // both ends of a pipe, which says that it is over
  std::string path_;             // of a socket of the file system
  int port_ = 0;
  std::thread thread_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_LISTENER_H_
