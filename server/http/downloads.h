// Results over HTTP, as files: single frames, an output's frames as a zip archive, and outputs that are one file. All
// of them with Range, ETag, conditions and HEAD.
//
// Errors before the first byte are answered as errors.h says; what fails later closes the connection in the middle of
// the body, so that no client takes a part for the whole.
#ifndef DEPTHTWEEN_SERVER_HTTP_DOWNLOADS_H_
#define DEPTHTWEEN_SERVER_HTTP_DOWNLOADS_H_

#include <boost/asio/awaitable.hpp>
#include <string>

#include "server/http/calls.h"
#include "server/http/exchange.h"
#include "server/http/file_route.h"
#include "server/http/frame_archive.h"

namespace depthtween::server {

// Threads: handlers may run concurrently, each on the executor of its exchange. Must outlive them.
class Downloads {
 public:
  explicit Downloads(RpcChannel& channel) : channel_(channel) {}

  // A frame that is stored, also while its job runs. 404 if it is not (yet) there or there is none in this encoding.
  boost::asio::awaitable<void> SendFrame(Exchange& exchange, const FileRoute& route);
  boost::asio::awaitable<void> SendFile(Exchange& exchange, const FileRoute& route);
  // Streamed without being stored: it leaves with the first frame, so its length is not known, unless it was read
  // before; a part of it costs reading all frames once, see frame_archive.h. 400 FAILED_PRECONDITION unless the job has
  // SUCCEEDED.
  boost::asio::awaitable<void> SendArchive(Exchange& exchange, const FileRoute& route);

 private:
  // Layouts take 100 bytes a frame: room for a dozen outputs of 10,000 frames.
  static constexpr int64_t kLayoutBytes = 16 << 20;

  RpcChannel& channel_;
  ArchiveLayouts layouts_{kLayoutBytes};
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_DOWNLOADS_H_
