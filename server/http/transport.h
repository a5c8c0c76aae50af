// A connection with or without TLS, as coroutines. Every operation has a time limit, after which the connection is
// closed and the operation fails.
//
// Threads: on the executor that it was made with, one operation at a time.
#ifndef DEPTHTWEEN_SERVER_HTTP_TRANSPORT_H_
#define DEPTHTWEEN_SERVER_HTTP_TRANSPORT_H_

#include <boost/asio/awaitable.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstddef>
#include <memory>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"

namespace depthtween::server {

class Transport {
 public:
  virtual ~Transport() = default;

  virtual boost::asio::any_io_executor executor() = 0;
  // TLS; without it nothing.
  virtual boost::asio::awaitable<absl::Status> Handshake(absl::Time deadline) = 0;
  // Some bytes; 0 at the end of the stream. DeadlineExceeded at `deadline`; Cancelled: the peer is gone.
  virtual boost::asio::awaitable<absl::StatusOr<size_t>> ReadSome(char* data, size_t size, absl::Time deadline) = 0;
  // All pieces. The limit holds for each part that the peer takes: DeadlineExceeded when it takes nothing for so long.
  virtual boost::asio::awaitable<absl::Status> Write(std::vector<std::string_view> pieces, absl::Duration patience) = 0;
  // Says goodbye, so that the peer gets all that was written even if it still sends.
  virtual boost::asio::awaitable<void> ShutDown(absl::Time deadline) = 0;
  // At once, also while an operation is under way.
  virtual void Close() = 0;
  // Whether the peer has closed the connection, or its writing half; asks the system without reading.
  virtual bool PeerIsGone() = 0;
};

// `tls` is null for a connection without.
std::unique_ptr<Transport> MakeTransport(boost::asio::ip::tcp::socket socket,
                                         const std::shared_ptr<boost::asio::ssl::context>& tls);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_TRANSPORT_H_
