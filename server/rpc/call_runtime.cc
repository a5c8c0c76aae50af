#include "server/rpc/call_runtime.h"

#include <grpcpp/server_context.h>

#include <exception>
#include <new>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "server/telemetry/log.h"
#include "server/telemetry/request_id.h"

namespace depthtween::server {
namespace {

std::string RequestId(const grpc::CallbackServerContext& context) {
  const auto found = context.client_metadata().find(kRequestIdKey);
  if (found == context.client_metadata().end()) return ChooseRequestId("");
  return ChooseRequestId({found->second.data(), found->second.size()});
}

// A fault of ours is an error. A fault of the client is worth a line. All else is for debugging.
LogLevel LevelOf(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kOk:
    case absl::StatusCode::kCancelled:
      return LogLevel::kDebug;
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kUnknown:
      return LogLevel::kError;
    default:
      return LogLevel::kInfo;
  }
}

}  // namespace

CallRuntime::CallRuntime(const DataDirectory& directory, int threads, int max_calls)
    : directory_(directory), max_calls_(max_calls), executor_(threads) {}

CallRuntime::~CallRuntime() {
  std::unique_lock lock(mutex_);
  none_left_.wait(lock, [this] { return calls_ == 0; });
}

grpc::ServerUnaryReactor* CallRuntime::Unary(grpc::CallbackServerContext* context, std::string_view method,
                                             std::string_view subject,
                                             std::function<absl::Status(const Caller&)> work) {
  auto call = std::make_shared<Call>(*this, context, method, subject);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (!call->admission().ok()) {
    reactor->Finish(call->Answer(call->admission()));
    return reactor;
  }
  executor_.Post([reactor, call = std::move(call), work = std::move(work)] {
    reactor->Finish(call->Answer(CatchExceptions([&] { return work(call->caller()); })));
  });
  return reactor;
}

void CallRuntime::Register(const std::shared_ptr<Stoppable>& stream) {
  bool stopping = false;
  {
    const std::lock_guard lock(mutex_);
    streams_.remove_if([](const auto& other) { return other.expired(); });
    streams_.push_back(stream);
    stopping = stopping_;
  }
  if (stopping) stream->Stop();
}

void CallRuntime::Stop() {
  std::list<std::weak_ptr<Stoppable>> streams;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    streams.swap(streams_);
  }
  for (const auto& weak : streams) {
    if (const auto stream = weak.lock()) stream->Stop();
  }
}

absl::Status CallRuntime::Admit() {
  const std::lock_guard lock(mutex_);
  ++calls_;  // refused ones too: they are in flight until they are answered
  if (stopping_) return ServerStopping();
  if (calls_ > max_calls_) {
    return ServerBusy(absl::StrFormat("%d calls are being answered, which is the limit; try again later", max_calls_));
  }
  return absl::OkStatus();
}

void CallRuntime::Leave() {
  const std::lock_guard lock(mutex_);
  if (--calls_ == 0) none_left_.notify_all();
}

Call::Call(CallRuntime& runtime, grpc::CallbackServerContext* context, std::string_view method,
           std::string_view subject)
    : runtime_(runtime),
      method_(method),
      names_{.subject = std::string(subject), .request_id = RequestId(*context)},
      peer_(context->peer()),
      start_(absl::Now()),
      admission_(runtime.Admit()) {
  context->AddInitialMetadata(kRequestIdKey, names_.request_id);
}

Call::~Call() { runtime_.Leave(); }

grpc::Status Call::Answer(const absl::Status& status) const {
  Log(LevelOf(status.code()), "call",
      {{"method", method_},
       {"code", absl::StatusCodeToString(status.code())},
       {"ms", absl::StrFormat("%.1f", absl::ToDoubleMilliseconds(absl::Now() - start_))},
       {"subject", names_.subject},
       {"request", names_.request_id},
       {"peer", peer_},
       {"detail", std::string(status.message())}});
  return ToGrpcStatus(runtime_.directory_.WithoutPath(status), names_);
}

absl::Status CatchExceptions(const std::function<absl::Status()>& work) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    return ServerBusy("the server is out of memory for this call; try again later");
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrFormat("unexpected failure, please report it: %s", error.what()));
  }
}

}  // namespace depthtween::server
