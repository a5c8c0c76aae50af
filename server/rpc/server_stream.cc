#include "server/rpc/server_stream.h"

#include <grpcpp/alarm.h>

#include <functional>

namespace depthtween::server {

StreamDriver::StreamDriver(CallRuntime& runtime, grpc::CallbackServerContext* context, std::string_view method,
                           std::string_view subject)
    : call_(runtime, context, CallKind::kStream, method, subject) {}

StreamDriver::~StreamDriver() = default;

void StreamDriver::Start() {
  self_ = shared_from_this();
  call_.runtime().Register(self_);
  Schedule();
}

void StreamDriver::Wake() {
  {
    const std::lock_guard lock(mutex_);
    woken_ = true;
    if (running_ || ahead_) return;  // Produce() will be called anyway
    running_ = true;
  }
  Schedule();
}

void StreamDriver::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  Wake();
}

void StreamDriver::Cancel() {
  {
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
  }
  Wake();
}

void StreamDriver::Sent(bool ok) {
  bool next = false;
  {
    const std::lock_guard lock(mutex_);
    if (!ok) cancelled_ = true;
    next = ahead_ && !cancelled_ && !stopping_;
    sending_ = next;
    ahead_ = false;
    if (running_) return;  // it sees that gRPC is free
    running_ = true;
  }
  if (next) StartSending();
  Schedule();
}

void StreamDriver::Retire() {
  // The executor or a waker may hold the stream a moment longer than gRPC.
  const std::shared_ptr<StreamDriver> self = std::move(self_);
}

void StreamDriver::WakeAt(absl::Time time) {
  alarm_ = std::make_unique<grpc::Alarm>();
  alarm_->Set(absl::ToChronoTime(time), [wake = Waker()](bool fired) {
    if (fired) wake();
  });
}

std::function<void()> StreamDriver::Waker() {
  return [weak = weak_from_this()] {
    if (const auto stream = weak.lock()) stream->Wake();
  };
}

void StreamDriver::Schedule() {
  call_.runtime().executor().Post([stream = shared_from_this()] { stream->Run(); });
}

absl::StatusOr<StreamDriver::Next> StreamDriver::Make(bool cancelled, bool stopping) {
  Next next = Next::kEnd;
  RETURN_IF_ERROR(CatchExceptions([&]() -> absl::Status {
    if (cancelled) return absl::CancelledError("the client is gone");
    if (stopping) return ServerStopping();
    RETURN_IF_ERROR(call_.admission());
    ASSIGN_OR_RETURN(next, Produce());
    return absl::OkStatus();
  }));
  return next;
}

void StreamDriver::Run() {
  while (true) {
    bool cancelled = false, stopping = false;
    {
      const std::lock_guard lock(mutex_);
      woken_ = false;
      cancelled = cancelled_;
      stopping = stopping_;
    }
    Next next = Next::kEnd;
    if (!end_) {
      const absl::StatusOr<Next> made = Make(cancelled, stopping);
      if (!made.ok() || *made == Next::kEnd) {
        end_ = made.status();
      } else {
        next = *made;
      }
    }
    {
      const std::lock_guard lock(mutex_);
      if (next == Next::kWait) {
        if (woken_) continue;
        running_ = false;
        return;
      }
      if (sending_) {  // gRPC takes one thing at a time: Sent() goes on
        ahead_ = next == Next::kMessage;
        running_ = false;
        return;
      }
      sending_ = next == Next::kMessage;
    }
    if (end_) {
      alarm_.reset();
      Release();
      FinishCall(call_.Answer(*end_));
      return;
    }
    StartSending();
  }
}

}  // namespace depthtween::server
