#include "server/rpc/call_runtime.h"

#include <grpcpp/server_context.h>

#include <algorithm>
#include <exception>
#include <new>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "server/rpc/method_rules.h"
#include "server/telemetry/log.h"
#include "server/telemetry/metrics.h"
#include "server/telemetry/request_id.h"

namespace depthtween::server {
namespace {

// Of our own listener for HTTP, which calls without a network: who is at its other end.
constexpr char kPeerKey[] = "depthtween-peer";
constexpr char kLinkKey[] = "depthtween-link";

// The value of the first entry; empty if there is none.
std::string Metadata(const grpc::CallbackServerContext& context, const char* key) {
  const auto found = context.client_metadata().find(key);
  if (found == context.client_metadata().end()) return {};
  return {found->second.data(), found->second.size()};
}

std::string PeerOf(const grpc::CallbackServerContext& context) {
  const std::string peer = context.peer();
  const std::string behind = Metadata(context, kPeerKey);
  // A call from within the process has no address: gRPC 1.51 says "unknown", later versions "inproc".
  const bool within = peer == "unknown" || peer.rfind("inproc", 0) == 0;
  return within && !behind.empty() ? behind : peer;
}

// "ipv4:10.0.0.7:41234" -> "ipv4:10.0.0.7": a client's connections count together.
std::string HostOfPeer(const std::string& peer) { return peer.substr(0, peer.rfind(':')); }

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

CallRuntime::CallRuntime(const DataDirectory& directory, Guard& guard, int threads, const CallRoom& room)
    : directory_(directory), guard_(guard), room_(room), executor_(threads) {}

CallRuntime::~CallRuntime() {
  std::unique_lock lock(mutex_);
  none_left_.wait(lock, [this] { return in_flight_.empty(); });
}

grpc::ServerUnaryReactor* CallRuntime::Unary(grpc::CallbackServerContext* context, std::string_view method,
                                             std::string_view subject,
                                             std::function<absl::Status(const Caller&)> work) {
  const CallKind kind = ScopeOfMethod(method) ? CallKind::kCall : CallKind::kHealth;
  auto call = std::make_shared<Call>(*this, context, kind, method, subject);
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

void CallRuntime::WaitUntilIdle(absl::Time deadline) {
  std::unique_lock lock(mutex_);
  none_left_.wait_until(lock, absl::ToChronoTime(deadline), [this] { return in_flight_.empty(); });
}

absl::Status CallRuntime::Admit(CallKind kind, const std::vector<std::string>& clients) {
  const std::lock_guard lock(mutex_);
  const int in_flight = ++in_flight_[kind];
  int most_of_one = 0;
  for (const std::string& client : clients) most_of_one = std::max(most_of_one, ++streams_of_[client]);
  if (stopping_) return ServerStopping();
  const auto busy = [](int limit, absl::string_view what) {
    return ServerBusy(absl::StrFormat("%d %s, which is the limit; try again later", limit, what));
  };
  switch (kind) {
    case CallKind::kCall:
      if (in_flight > room_.calls) return busy(room_.calls, "calls are being answered");
      break;
    case CallKind::kStream:
      if (in_flight > room_.streams) return busy(room_.streams, "streams are open");
      if (most_of_one > room_.streams_of_client)
        return busy(room_.streams_of_client, "streams of this client are open");
      break;
    case CallKind::kHealth:
      if (in_flight > room_.health) return busy(room_.health, "questions about health are being answered");
      break;
  }
  return absl::OkStatus();
}

void CallRuntime::Leave(CallKind kind, const std::vector<std::string>& clients) {
  const std::lock_guard lock(mutex_);
  for (const std::string& client : clients) {
    if (const auto found = streams_of_.find(client); --found->second == 0) streams_of_.erase(found);
  }
  if (--in_flight_[kind] == 0) in_flight_.erase(kind);
  if (in_flight_.empty()) none_left_.notify_all();
}

Call::Call(CallRuntime& runtime, grpc::CallbackServerContext* context, CallKind kind, std::string_view method,
           std::string_view subject)
    : runtime_(runtime),
      kind_(kind),
      method_(method),
      scope_(ScopeOfMethod(method)),
      names_{.subject = std::string(subject), .request_id = ChooseRequestId(Metadata(*context, kRequestIdKey))},
      traceparent_(ContinueTrace(Metadata(*context, kTraceparentKey))),
      peer_(PeerOf(*context)),
      start_(absl::Now()),
      admission_(Enter(*context)) {
  context->AddInitialMetadata(kRequestIdKey, names_.request_id);
  context->AddInitialMetadata(kTraceparentKey, traceparent_);
}

Call::~Call() { runtime_.Leave(kind_, clients_); }

absl::Status Call::Enter(const grpc::CallbackServerContext& context) {
  absl::Status refused;
  if (scope_) {
    absl::StatusOr<Caller> caller = runtime_.guard_.Admit(
        {.authorization = Metadata(context, "authorization"), .link = Metadata(context, kLinkKey)},
        {.scope = *scope_, .link_opens = LinkOpensMethod(method_)}, names_.subject);
    refused = caller.status();
    if (caller.ok()) caller_ = *std::move(caller);
  }
  // A call that is refused anyway does not count among its client's.
  if (kind_ == CallKind::kStream && refused.ok()) {
    clients_ = {"tenant " + caller_.tenant.name(), HostOfPeer(peer_)};
  }
  const absl::Status room = runtime_.Admit(kind_, clients_);
  return refused.ok() ? room : refused;
}

grpc::Status Call::Answer(const absl::Status& status) const {
  const std::string tenant = admission_.ok() ? caller_.tenant.name() : std::string();
  Log(LevelOf(status.code()), "call",
      {{"method", method_},
       {"code", absl::StatusCodeToString(status.code())},
       {"ms", absl::StrFormat("%.1f", absl::ToDoubleMilliseconds(absl::Now() - start_))},
       {"subject", names_.subject},
       {"request", names_.request_id},
       {"trace", TraceOf(traceparent_)},
       {"tenant", tenant},
       {"token", caller_.token_id},
       {"peer", peer_},
       {"detail", std::string(status.message())}});
  CountCall(method_, absl::StatusCodeToString(status.code()), absl::ToDoubleSeconds(absl::Now() - start_));
  if (scope_ && *scope_ != Scope::kRead) {
    LogInfo("audit", {{"method", method_},
                      {"subject", names_.subject},
                      {"result", absl::StatusCodeToString(status.code())},
                      {"tenant", tenant},
                      {"token", caller_.token_id},
                      {"request", names_.request_id},
                      {"trace", TraceOf(traceparent_)},
                      {"peer", peer_}});
  }
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
