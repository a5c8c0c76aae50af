// gRPC calls as coroutines, by the full name of the method ("/depthtween.v1.JobService/GetJob"), over the server's own
// channel: so that whatever comes over HTTP passes the same guard as what comes over gRPC.
//
// Every call carries, of the exchange it is made for: authorization, x-request-id, traceparent, the deadline that
// grpc-timeout gives, depthtween-peer (the client's address, never what a client says), and the query parameter
// "signature" as depthtween-link. Nothing else of the client's headers. It is cancelled when the exchange's client goes
// away.
//
// Threads: everything on the exchange's executor. One read and one write of a stream may be waited for at the same
// time.
#ifndef DEPTHTWEEN_SERVER_HTTP_CALLS_H_
#define DEPTHTWEEN_SERVER_HTTP_CALLS_H_

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <boost/asio/awaitable.hpp>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "absl/time/time.h"
#include "server/http/exchange.h"

namespace grpc {
class Channel;
}

namespace depthtween::server {

// The metadata that a call for this request carries.
std::map<std::string, std::string> CallMetadata(const HttpRequest& request);

// "10S", as gRPC's PROTOCOL-HTTP2 has it: up to 8 digits and H, M, S, m, u or n. nullopt for anything else.
std::optional<absl::Duration> ParseGrpcTimeout(std::string_view text);

// What calls of any kind need of the server. Must outlive all calls made with it.
class RpcChannel {
 public:
  explicit RpcChannel(std::shared_ptr<grpc::Channel> channel);
  // Waits until gRPC has forgotten every call; their exchanges must be over.
  ~RpcChannel();
  RpcChannel(const RpcChannel&) = delete;
  RpcChannel& operator=(const RpcChannel&) = delete;

  class Open;
  Open& open() const { return *open_; }

 private:
  const std::unique_ptr<Open> open_;
};

// One call. Of every kind: client-streaming calls write many, server-streaming calls read many.
//   (Write* CloseWriting | WriteLast) Read* Finish
class RpcCall {
 public:
  // Starts it. Borrows the exchange.
  RpcCall(RpcChannel& channel, Exchange& exchange, const std::string& method);
  // Cancels the call if it has not finished.
  ~RpcCall();
  RpcCall(const RpcCall&) = delete;
  RpcCall& operator=(const RpcCall&) = delete;

  // false: the call has ended; Finish says why.
  boost::asio::awaitable<bool> Write(const google::protobuf::Message& message);
  boost::asio::awaitable<bool> WriteLast(const google::protobuf::Message& message);
  boost::asio::awaitable<bool> WriteLast(grpc::ByteBuffer message);
  boost::asio::awaitable<void> CloseWriting();
  // false: there is no more; Finish says why.
  boost::asio::awaitable<bool> Read(google::protobuf::Message* message);
  boost::asio::awaitable<bool> Read(grpc::ByteBuffer* message);
  // The same within `patience`; nullopt: there is none yet, read again.
  boost::asio::awaitable<std::optional<bool>> ReadWithin(absl::Duration patience, google::protobuf::Message* message);
  boost::asio::awaitable<std::optional<bool>> ReadWithin(absl::Duration patience, grpc::ByteBuffer* message);
  // Waits for the end and returns the answer's status; what is still to be read is dropped. Cancel first so as not to
  // wait.
  boost::asio::awaitable<grpc::Status> Finish();
  // From any coroutine of the exchange: whoever waits gets false, and Finish says CANCELLED.
  void Cancel();

  class State;

 private:
  std::shared_ptr<State> state_;
  std::unique_ptr<Exchange::GoneWatch> gone_;
};

// A call with one message each way.
boost::asio::awaitable<grpc::Status> CallUnary(RpcChannel& channel, Exchange& exchange, const std::string& method,
                                               const google::protobuf::Message& request,
                                               google::protobuf::Message* response);
boost::asio::awaitable<grpc::Status> CallUnary(RpcChannel& channel, Exchange& exchange, const std::string& method,
                                               grpc::ByteBuffer request, grpc::ByteBuffer* response);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_CALLS_H_
