#include "server/http/calls.h"

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/support/client_callback.h>
#include <grpcpp/support/proto_buffer_reader.h>
#include <grpcpp/support/proto_buffer_writer.h>

#include <algorithm>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <condition_variable>
#include <mutex>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/time/clock.h"
#include "server/telemetry/request_id.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;

constexpr size_t kMaxCredentialBytes = 4096;

// What gRPC accepts as the value of metadata.
bool IsMetadataValue(std::string_view value) {
  return !value.empty() && value.size() <= kMaxCredentialBytes &&
         std::all_of(value.begin(), value.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

void FillContext(const HttpRequest& request, grpc::ClientContext& context) {
  for (const auto& [key, value] : CallMetadata(request)) context.AddMetadata(key, value);
  const std::optional<absl::Duration> timeout = ParseGrpcTimeout(request.Header("grpc-timeout").value_or(""));
  if (timeout) context.set_deadline(absl::ToChronoTime(absl::Now() + *timeout));
}

grpc::ByteBuffer Serialize(const google::protobuf::Message& message) {
  grpc::ByteBuffer bytes;
  bool owned = false;
  grpc::GenericSerialize<grpc::ProtoBufferWriter, google::protobuf::Message>(message, &bytes, &owned);
  return bytes;
}

grpc::Status Parse(grpc::ByteBuffer* bytes, google::protobuf::Message* message) {
  return grpc::GenericDeserialize<grpc::ProtoBufferReader, google::protobuf::Message>(bytes, message);
}

// Something that a coroutine waits for and that is set once per wait. On the executor only.
class Signal {
 public:
  explicit Signal(const asio::any_io_executor& executor) : timer_(executor, asio::steady_timer::time_point::max()) {}

  void Set() {
    set_ = true;
    timer_.cancel();
  }
  asio::awaitable<void> Wait() {
    while (!set_) co_await timer_.async_wait(asio::as_tuple(asio::use_awaitable));
    set_ = false;
  }
  // false: not yet.
  asio::awaitable<bool> WaitWithin(absl::Duration patience) {
    timer_.expires_after(absl::ToChronoNanoseconds(patience));
    if (!set_) co_await timer_.async_wait(asio::as_tuple(asio::use_awaitable));
    timer_.expires_at(asio::steady_timer::time_point::max());
    co_return std::exchange(set_, false);
  }

 private:
  asio::steady_timer timer_;  // cancelling it wakes the waiter; without patience it never expires
  bool set_ = false;
};

}  // namespace

std::map<std::string, std::string> CallMetadata(const HttpRequest& request) {
  std::map<std::string, std::string> metadata = {{"depthtween-peer", request.peer},
                                                 {kRequestIdKey, request.request_id}};
  if (const auto authorization = request.Header("authorization"); authorization && IsMetadataValue(*authorization)) {
    metadata["authorization"] = *authorization;
  }
  if (!request.traceparent.empty()) metadata[kTraceparentKey] = request.traceparent;
  if (const auto signature = request.Query("signature"); signature && IsMetadataValue(*signature)) {
    metadata["depthtween-link"] = *signature;
  }
  return metadata;
}

std::optional<absl::Duration> ParseGrpcTimeout(std::string_view text) {
  constexpr size_t kMaxDigits = 8;
  if (text.size() < 2 || text.size() > kMaxDigits + 1) return std::nullopt;
  int64_t count = 0;
  for (const char c : text.substr(0, text.size() - 1)) {
    if (!absl::ascii_isdigit(static_cast<unsigned char>(c))) return std::nullopt;
    count = 10 * count + (c - '0');
  }
  switch (text.back()) {
    case 'H':
      return absl::Hours(count);
    case 'M':
      return absl::Minutes(count);
    case 'S':
      return absl::Seconds(count);
    case 'm':
      return absl::Milliseconds(count);
    case 'u':
      return absl::Microseconds(count);
    case 'n':
      return absl::Nanoseconds(count);
    default:
      return std::nullopt;
  }
}

// ---- the channel ----

namespace {

// How many calls gRPC knows of. What gRPC calls back keeps this and never the channel: whoever drops the last reference
// to a channel ends gRPC's threads for callbacks, and one of these cannot wait for its own end (grpc/grpc#32584).
class OpenCalls {
 public:
  void Enter() {
    const std::lock_guard lock(mutex_);
    ++calls_;
  }
  void Leave() {
    const std::lock_guard lock(mutex_);
    if (--calls_ == 0) none_left_.notify_all();
  }
  void WaitUntilNone() {
    std::unique_lock lock(mutex_);
    none_left_.wait(lock, [this] { return calls_ == 0; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable none_left_;
  int calls_ = 0;  // guarded by mutex_
};

}  // namespace

class RpcChannel::Open {
 public:
  explicit Open(std::shared_ptr<grpc::Channel> channel) : stub_(std::move(channel)) {}

  grpc::GenericStub& stub() { return stub_; }
  const std::shared_ptr<OpenCalls>& calls() const { return calls_; }

 private:
  grpc::GenericStub stub_;
  const std::shared_ptr<OpenCalls> calls_ = std::make_shared<OpenCalls>();
};

RpcChannel::RpcChannel(std::shared_ptr<grpc::Channel> channel) : open_(std::make_unique<Open>(std::move(channel))) {}

RpcChannel::~RpcChannel() { open_->calls()->WaitUntilNone(); }

// ---- streams ----

// What gRPC calls back. It keeps itself until OnDone, and hands every report over to the executor.
class RpcCall::State : public grpc::ClientBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                       public std::enable_shared_from_this<RpcCall::State> {
 public:
  State(std::shared_ptr<OpenCalls> calls, asio::any_io_executor executor)
      : calls_(std::move(calls)), executor_(std::move(executor)) {}

  void Start(grpc::GenericStub& stub, const HttpRequest& request, const std::string& method) {
    self_ = shared_from_this();
    calls_->Enter();
    FillContext(request, context_);
    stub.PrepareBidiStreamingCall(&context_, method, {}, this);
    AddHold();  // operations start from outside of the reactor, until Release
    StartCall();
  }
  void Release() {
    if (std::exchange(released_, true)) return;
    RemoveHold();
  }
  void Cancel() { context_.TryCancel(); }

  void OnReadDone(bool ok) override {
    asio::post(executor_, [self = shared_from_this(), ok] {
      self->read_ok = ok;
      self->read.Set();
    });
  }
  void OnWriteDone(bool ok) override {
    asio::post(executor_, [self = shared_from_this(), ok] {
      self->write_ok = ok;
      self->written.Set();
    });
  }
  void OnWritesDoneDone(bool ok) override { OnWriteDone(ok); }
  void OnDone(const grpc::Status& status) override {
    // The executor may forget this before the next line is reached, and after Leave() there may be no executor: nothing
    // of it is held here any more by then.
    const std::shared_ptr<OpenCalls> calls = calls_;
    asio::any_io_executor executor = executor_;
    std::shared_ptr<State> self = std::move(self_);
    asio::post(std::exchange(executor, {}), [self = std::move(self), status] {
      self->status = status;
      self->done.Set();
    });
    calls->Leave();
  }

 private:
  const std::shared_ptr<OpenCalls> calls_;
  const asio::any_io_executor executor_;
  grpc::ClientContext context_;
  std::shared_ptr<State> self_;
  bool released_ = false;

 public:
  // On the executor only.
  Signal read{executor_}, written{executor_}, done{executor_};
  bool read_ok = true, write_ok = false;
  bool reading = false;
  bool finished = false;
  grpc::ByteBuffer to_write, to_read;  // while an operation is under way
  grpc::Status status;
};

RpcCall::RpcCall(RpcChannel& channel, Exchange& exchange, const std::string& method)
    : state_(std::make_shared<State>(channel.open().calls(), exchange.executor())) {
  state_->Start(channel.open().stub(), exchange.request(), method);
  gone_ = exchange.WhenGone([state = state_] { state->Cancel(); });
}

RpcCall::~RpcCall() {
  if (!state_->finished) state_->Cancel();
  state_->Release();
}

asio::awaitable<bool> RpcCall::Write(const google::protobuf::Message& message) {
  state_->to_write = Serialize(message);
  state_->StartWrite(&state_->to_write);
  co_await state_->written.Wait();
  co_return state_->write_ok;
}

asio::awaitable<bool> RpcCall::WriteLast(const google::protobuf::Message& message) {
  const grpc::ByteBuffer bytes = Serialize(message);
  co_return co_await WriteLast(bytes);
}

asio::awaitable<bool> RpcCall::WriteLast(grpc::ByteBuffer message) {
  state_->to_write = message;
  state_->StartWriteLast(&state_->to_write, grpc::WriteOptions());
  co_await state_->written.Wait();
  co_return state_->write_ok;
}

asio::awaitable<void> RpcCall::CloseWriting() {
  state_->StartWritesDone();
  co_await state_->written.Wait();
}

asio::awaitable<bool> RpcCall::Read(grpc::ByteBuffer* message) {
  std::optional<bool> read;
  while (!read) read = co_await ReadWithin(absl::Hours(1), message);
  co_return *read;
}

asio::awaitable<bool> RpcCall::Read(google::protobuf::Message* message) {
  std::optional<bool> read;
  while (!read) read = co_await ReadWithin(absl::Hours(1), message);
  co_return *read;
}

asio::awaitable<std::optional<bool>> RpcCall::ReadWithin(absl::Duration patience, grpc::ByteBuffer* message) {
  if (!state_->read_ok) co_return false;
  if (!std::exchange(state_->reading, true)) {
    state_->to_read.Clear();
    state_->StartRead(&state_->to_read);
  }
  const bool read = co_await state_->read.WaitWithin(patience);
  if (!read) co_return std::nullopt;
  state_->reading = false;
  if (state_->read_ok) message->Swap(&state_->to_read);
  co_return state_->read_ok;
}

asio::awaitable<std::optional<bool>> RpcCall::ReadWithin(absl::Duration patience, google::protobuf::Message* message) {
  grpc::ByteBuffer bytes;
  const std::optional<bool> read = co_await ReadWithin(patience, &bytes);
  if (!read || !*read || Parse(&bytes, message).ok()) co_return read;
  Cancel();  // both sides are one program: its own message that it cannot read is memory gone wrong
  co_return false;
}

asio::awaitable<grpc::Status> RpcCall::Finish() {
  grpc::ByteBuffer dropped;
  while (co_await Read(&dropped)) {
  }
  state_->Release();
  co_await state_->done.Wait();
  state_->finished = true;
  co_return state_->status;
}

void RpcCall::Cancel() { state_->Cancel(); }

// ---- unary calls ----

namespace {

struct UnaryState {
  explicit UnaryState(const asio::any_io_executor& executor) : done(executor) {}

  grpc::ClientContext context;
  grpc::ByteBuffer request, response;
  grpc::Status status;  // on the executor only
  Signal done;
};

}  // namespace

asio::awaitable<grpc::Status> CallUnary(RpcChannel& channel, Exchange& exchange, const std::string& method,
                                        grpc::ByteBuffer request, grpc::ByteBuffer* response) {
  // Not const: what the callback captures of them must be movable.
  asio::any_io_executor executor = exchange.executor();
  auto state = std::make_shared<UnaryState>(executor);
  state->request = request;
  FillContext(exchange.request(), state->context);
  std::shared_ptr<OpenCalls> calls = channel.open().calls();
  calls->Enter();
  channel.open().stub().UnaryCall(&state->context, method, {}, &state->request, &state->response,
                                  // As in RpcCall::State::OnDone.
                                  [state, executor, calls](const grpc::Status& status) mutable {
                                    const std::shared_ptr<OpenCalls> last = std::move(calls);
                                    asio::post(std::exchange(executor, {}), [state = std::move(state), status] {
                                      state->status = status;
                                      state->done.Set();
                                    });
                                    last->Leave();
                                  });
  const auto gone = exchange.WhenGone([state] { state->context.TryCancel(); });
  co_await state->done.Wait();
  response->Swap(&state->response);
  co_return state->status;
}

asio::awaitable<grpc::Status> CallUnary(RpcChannel& channel, Exchange& exchange, const std::string& method,
                                        const google::protobuf::Message& request, google::protobuf::Message* response) {
  grpc::ByteBuffer answer;
  grpc::ByteBuffer bytes = Serialize(request);
  grpc::Status status = co_await CallUnary(channel, exchange, method, bytes, &answer);
  if (!status.ok()) co_return status;
  co_return Parse(&answer, response);
}

}  // namespace depthtween::server
