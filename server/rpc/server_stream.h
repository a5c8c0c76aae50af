// A stream from the server that is pulled: Produce() makes one message at a time, at most one ahead of the one that is
// being sent. So a slow reader slows only itself, and costs two messages of memory and no thread.
//
// Every event (a message was sent, there is news, a timer fired, the client is gone, the server stops) only wakes the
// stream; Produce() runs on the executor and never concurrently with itself.
#ifndef DEPTHTWEEN_SERVER_RPC_SERVER_STREAM_H_
#define DEPTHTWEEN_SERVER_RPC_SERVER_STREAM_H_

#include <grpcpp/support/server_callback.h>

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/rpc/call_runtime.h"

namespace grpc {
class Alarm;
}

namespace depthtween::server {

// What does not depend on the kind of message.
class StreamDriver : public Stoppable, public std::enable_shared_from_this<StreamDriver> {
 public:
  ~StreamDriver() override;

  // Starts. From then on the stream owns itself until gRPC is done with it.
  void Start();
  // There may be something to do: Produce() will be called (again). From any thread; returns at once.
  void Wake();
  void Stop() override;

 protected:
  enum class Next {
    kMessage,  // the message is there: send it, then ask again
    kWait,     // nothing now: ask again when woken
    kEnd,      // nothing any more: the stream ends with OK
  };

  StreamDriver(CallRuntime& runtime, grpc::CallbackServerContext* context, std::string_view method,
               std::string_view subject);

  // An error ends the stream with it.
  virtual absl::StatusOr<Next> Produce() = 0;
  // Called once, after the last Produce and before the end: release what could still call Wake().
  virtual void Release() {}
  // Sends what Produce() made last; the next Produce() fills another message.
  virtual void StartSending() = 0;
  virtual void FinishCall(const grpc::Status& status) = 0;

  // Whose resources the call may see.
  const Tenant& tenant() const { return call_.caller().tenant; }

  // Wakes the stream at `time`, unless called again before.
  void WakeAt(absl::Time time);
  // A function that wakes the stream, or does nothing when it is gone.
  std::function<void()> Waker();

  // What gRPC reports.
  void Sent(bool ok);
  void Cancel();
  void Retire();

 private:
  void Schedule();
  void Run();
  // Produce() and what may stand in its way.
  absl::StatusOr<Next> Make(bool cancelled, bool stopping);

  Call call_;
  std::unique_ptr<grpc::Alarm> alarm_;  // of Run's turn
  std::optional<absl::Status> end_;     // of Run's turn; how the call ends once gRPC is free
  std::mutex mutex_;
  bool running_ = true;                 // guarded by mutex_; Run() is posted, or at work
  bool sending_ = false;                // guarded by mutex_; gRPC has a message
  bool ahead_ = false;                  // guarded by mutex_; another is made and waits for it
  bool woken_ = false;                  // guarded by mutex_; since Produce() was called last
  bool cancelled_ = false;              // guarded by mutex_
  bool stopping_ = false;               // guarded by mutex_
  std::shared_ptr<StreamDriver> self_;  // from Start to Retire
};

// Derive from this, fill message() in Produce(), and hand LaunchStream()'s result to gRPC.
template <typename Message>
class ServerStream : public grpc::ServerWriteReactor<Message>, public StreamDriver {
 public:
  void OnWriteDone(bool ok) final { Sent(ok); }
  void OnCancel() final { Cancel(); }
  void OnDone() final { Retire(); }

 protected:
  using StreamDriver::StreamDriver;
  // Holds what an earlier Produce() filled in, not always the one before.
  Message& message() { return messages_[filled_]; }

 private:
  void StartSending() final {
    const Message& made = message();
    filled_ = 1 - filled_;
    this->StartWrite(&made);
  }
  void FinishCall(const grpc::Status& status) final { this->Finish(status); }

  std::array<Message, 2> messages_;
  size_t filled_ = 0;
};

template <typename Stream, typename... Arguments>
Stream* LaunchStream(Arguments&&... arguments) {
  const auto stream = std::make_shared<Stream>(std::forward<Arguments>(arguments)...);
  stream->Start();
  return stream.get();
}

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_SERVER_STREAM_H_
