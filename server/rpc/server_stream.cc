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
    if (state_ != State::kIdle) return;  // Produce() will be called anyway
    state_ = State::kScheduled;
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
  {
    const std::lock_guard lock(mutex_);
    if (!ok) cancelled_ = true;
    state_ = State::kScheduled;
  }
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

void StreamDriver::Run() {
  while (true) {
    bool cancelled = false, stopping = false;
    {
      const std::lock_guard lock(mutex_);
      state_ = State::kRunning;
      woken_ = false;
      cancelled = cancelled_;
      stopping = stopping_;
    }
    Next next = Next::kEnd;
    const absl::Status status = CatchExceptions([&]() -> absl::Status {
      if (cancelled) return absl::CancelledError("the client is gone");
      if (stopping) return ServerStopping();
      RETURN_IF_ERROR(call_.admission());
      ASSIGN_OR_RETURN(next, Produce());
      return absl::OkStatus();
    });
    if (!status.ok() || next == Next::kEnd) {
      alarm_.reset();
      Release();
      FinishCall(call_.Answer(status));
      return;
    }
    if (next == Next::kMessage) {
      {
        const std::lock_guard lock(mutex_);
        state_ = State::kSending;
      }
      StartSending();
      return;
    }
    const std::lock_guard lock(mutex_);
    if (!woken_) {
      state_ = State::kIdle;
      return;
    }
  }
}

}  // namespace depthtween::server
