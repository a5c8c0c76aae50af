// Every call of every service passes through here: the guard says whose it is, it gets a request id, a place among the
// calls in flight, threads to run on, a mapped status and a line in the log. A call that changes something leaves a
// line of its own, "audit": who, what, with which result.
#ifndef DEPTHTWEEN_SERVER_RPC_CALL_RUNTIME_H_
#define DEPTHTWEEN_SERVER_RPC_CALL_RUNTIME_H_

#include <grpcpp/support/server_callback.h>

#include <condition_variable>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/access/caller.h"
#include "server/access/guard.h"
#include "server/rpc/executor.h"
#include "server/rpc/status.h"
#include "server/store/data_directory.h"

namespace grpc {
class CallbackServerContext;
}

namespace depthtween::server {

// A long call, which must end early when the server stops.
class Stoppable {
 public:
  virtual ~Stoppable() = default;
  // Returns at once; the call ends with ServerStopping() soon. May be called from any thread.
  virtual void Stop() = 0;
};

// How many calls may be in flight at the same time. Each kind has room of its own, so that however many watch or read,
// short calls and health are answered.
struct CallRoom {
  int calls = 1000;              // short ones
  int streams = 2000;            // watches, frames, uploads
  int streams_of_client = 1500;  // of them, of one tenant, and of one peer address
  int health = 100;              // checks and watches of health
};
enum class CallKind { kCall, kStream, kHealth };

class CallRuntime {
 public:
  // Threads: enough that a few slow disk reads do not keep short calls waiting; they sleep otherwise.
  // Calls beyond `room` are answered ServerBusy(). Borrows `directory`, whose path no answer names, and `guard`.
  CallRuntime(const DataDirectory& directory, Guard& guard, int threads, const CallRoom& room);
  // Waits until every call has been answered and forgotten.
  ~CallRuntime();

  // The whole life of a call without streams: `work` runs on the executor, its status is the answer. `subject` is the
  // name of the resource that the call is about, `method` the name in the log.
  grpc::ServerUnaryReactor* Unary(grpc::CallbackServerContext* context, std::string_view method,
                                  std::string_view subject, std::function<absl::Status(const Caller&)> work);

  // Registers a long call, which is told when the server stops.
  void Register(const std::shared_ptr<Stoppable>& stream);
  // From now on calls are answered ServerStopping(), and registered ones end.
  void Stop();
  // Returns when no call is in flight, or at `deadline`.
  void WaitUntilIdle(absl::Time deadline);

  Executor& executor() { return executor_; }

 private:
  friend class Call;
  // Takes a place, even where it refuses: the call is in flight until it is answered.
  absl::Status Admit(CallKind kind, const std::vector<std::string>& clients);
  void Leave(CallKind kind, const std::vector<std::string>& clients);

  const DataDirectory& directory_;
  Guard& guard_;
  const CallRoom room_;
  std::mutex mutex_;
  std::condition_variable none_left_;
  std::map<CallKind, int> in_flight_;                   // guarded by mutex_
  std::map<std::string, int, std::less<>> streams_of_;  // guarded by mutex_; by tenant and by peer address
  bool stopping_ = false;                               // guarded by mutex_
  std::list<std::weak_ptr<Stoppable>> streams_;         // guarded by mutex_
  Executor executor_;                                   // last: its threads use all of the above
};

// One call from its arrival to its answer.
class Call {
 public:
  // `method` is its name without the service; of health "Health.NAME".
  Call(CallRuntime& runtime, grpc::CallbackServerContext* context, CallKind kind, std::string_view method,
       std::string_view subject);
  // Leaves its place among the calls in flight.
  ~Call();
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  CallRuntime& runtime() { return runtime_; }
  // Why the call must be refused, or OK. Not before it is OK does caller() mean anything.
  const absl::Status& admission() const { return admission_; }
  const Caller& caller() const { return caller_; }
  // For calls that learn later which resource they are about.
  void SetSubject(std::string_view subject) { names_.subject = std::string(subject); }
  // What to finish the call with: the status without the server's paths, which its log keeps. Call it once.
  grpc::Status Answer(const absl::Status& status) const;

 private:
  // Asks the guard, then for a place.
  absl::Status Enter(const grpc::CallbackServerContext& context);

  CallRuntime& runtime_;
  const CallKind kind_;
  const std::string method_;
  const std::optional<Scope> scope_;  // that it needs
  CallNames names_;
  const std::string traceparent_;
  const std::string peer_;
  const absl::Time start_;
  Caller caller_ = {.tenant = Tenant(kDefaultTenant), .token_id = {}};
  std::vector<std::string> clients_;  // among whose streams it counts
  const absl::Status admission_;
};

// Runs `work`; an exception becomes Internal, or ResourceExhausted for lack of memory.
absl::Status CatchExceptions(const std::function<absl::Status()>& work);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_CALL_RUNTIME_H_
