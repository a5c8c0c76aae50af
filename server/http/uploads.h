// Recordings over HTTP: tus 1.0, and PUT with Content-Range. Both write an upload of SequenceService from the front to
// the back, and either may go on with what the other, or a client of gRPC, began.
//
// The last byte finishes the upload. A connection that breaks keeps what had arrived; HEAD (tus), or PUT with
// "Content-Range: bytes */SIZE", says where to go on.
#ifndef DEPTHTWEEN_SERVER_HTTP_UPLOADS_H_
#define DEPTHTWEEN_SERVER_HTTP_UPLOADS_H_

#include <atomic>
#include <boost/asio/awaitable.hpp>
#include <cstdint>

#include "server/http/calls.h"
#include "server/http/exchange.h"
#include "server/http/file_route.h"

namespace depthtween::server {

// Threads: handlers may run concurrently, each on the executor of its exchange. Must outlive them.
class Uploads {
 public:
  explicit Uploads(RpcChannel& channel) : channel_(channel) {}

  // PUT. 200 with the Upload as JSON; 409 with the header Upload-Offset if it does not begin where the upload stands.
  boost::asio::awaitable<void> Put(Exchange& exchange, const FileRoute& route);

  // tus, on the route that creates uploads of one file: OPTIONS, POST. Metadata: path (or filename), and if wished
  // sha256 and request_id.
  boost::asio::awaitable<void> CreateTus(Exchange& exchange, const FileRoute& route);
  // tus, on an upload: OPTIONS, HEAD, PATCH, DELETE, and POST with X-HTTP-Method-Override. DELETE answers 409 once it
  // is finished.
  boost::asio::awaitable<void> HandleTus(Exchange& exchange, const FileRoute& route);

 private:
  boost::asio::awaitable<void> HeadTus(Exchange& exchange, const FileRoute& route);
  boost::asio::awaitable<void> PatchTus(Exchange& exchange, const FileRoute& route);
  boost::asio::awaitable<void> DeleteTus(Exchange& exchange, const FileRoute& route);

  RpcChannel& channel_;
  // What bodies with an Upload-Checksum take that are being held until their last byte has come.
  std::atomic<int64_t> held_bytes_ = 0;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_UPLOADS_H_
