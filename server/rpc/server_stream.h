// A stream from the server that is pulled: Produce() makes one message at a time, and only when the message before it
// was sent. So a slow reader slows only itself, and costs one message of memory and no thread.
//
// Every event (a message was sent, there is news, a timer fired, the client is gone, the server stops) only wakes the
// stream; Produce() runs on the executor and never concurrently with itself.
#ifndef DEPTHTWEEN_SERVER_RPC_SERVER_STREAM_H_
#define DEPTHTWEEN_SERVER_RPC_SERVER_STREAM_H_

#include <grpcpp/support/server_callback.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string_view>
#include <utility>

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
  enum class State { kScheduled, kRunning, kSending, kIdle };
  void Schedule();
  void Run();

  Call call_;
  std::unique_ptr<grpc::Alarm> alarm_;  // of Produce's turn
  std::mutex mutex_;
  State state_ = State::kScheduled;     // guarded by mutex_
  bool woken_ = false;                  // guarded by mutex_; while kRunning
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
  Message& message() { return message_; }

 private:
  void StartSending() final { this->StartWrite(&message_); }
  void FinishCall(const grpc::Status& status) final { this->Finish(status); }

  Message message_;
};

template <typename Stream, typename... Arguments>
Stream* LaunchStream(Arguments&&... arguments) {
  const auto stream = std::make_shared<Stream>(std::forward<Arguments>(arguments)...);
  stream->Start();
  return stream.get();
}

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_SERVER_STREAM_H_
