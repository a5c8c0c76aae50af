// How messages of a server stream are written into an HTTP body.
#ifndef DEPTHTWEEN_SERVER_HTTP_STREAMS_H_
#define DEPTHTWEEN_SERVER_HTTP_STREAMS_H_

#include <string>
#include <string_view>

#include "google/rpc/status.pb.h"

namespace depthtween::server {

// application/x-ndjson: one JSON text a line. A stream that fails ends with a line {"error": <google.rpc.Status>}; one
// that does not has been read to its end.
std::string NdjsonMessage(std::string_view json);
std::string NdjsonError(const google::rpc::Status& error);

// text/event-stream (HTML standard, 9.2). Messages are unnamed events; `id` comes back as Last-Event-ID when the
// browser connects again, and may be empty. A stream that fails ends with an event "error", one that is complete with
// an event "end": a browser would otherwise take the end for a broken connection.
std::string SseMessage(std::string_view id, std::string_view json);
std::string SseError(const google::rpc::Status& error);
std::string SseEnd();
// A comment: keeps proxies and clients from giving up.
std::string SseHeartbeat();

// Whether an Accept header asks for this media type by name ("*/*" does not).
bool Accepts(std::string_view accept, std::string_view media_type);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_STREAMS_H_
