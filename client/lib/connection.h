// One server, and calls to it that survive its absence: a restart or a cut connection costs time, not work.
//
// Threads: safe to use concurrently.
#ifndef DEPTHTWEEN_CLIENT_LIB_CONNECTION_H_
#define DEPTHTWEEN_CLIENT_LIB_CONNECTION_H_

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "client/lib/backoff.h"
#include "client/lib/status.h"
#include "depthtween/v1/admin.grpc.pb.h"
#include "depthtween/v1/job.grpc.pb.h"
#include "depthtween/v1/output.grpc.pb.h"
#include "depthtween/v1/sequence.grpc.pb.h"

namespace depthtween::client {

// What is wrong with the address of a server; empty if nothing is.
std::string AddressProblem(const std::string& address);

struct ConnectionOptions {
  // host:port; without a port 50051.
  std::string address = "127.0.0.1:50051";
  // Speak TLS. `tls_roots`: PEM of those who may have signed the server's certificate; empty: the system's authorities.
  // `tls_cert`, `tls_key`: PEM of our own certificate, where the server asks for one.
  bool tls = false;
  std::string tls_roots, tls_cert, tls_key;
  // The secret of a bearer token; empty: none is sent.
  std::string token;
  // Time limit of a call that transfers no files or frames.
  std::chrono::milliseconds call_timeout{20'000};
  // How long to keep trying while the server does not answer, from the first call on.
  std::chrono::milliseconds patience{60'000};
  // Called once in each absence longer than a moment, by the call that waits; may be empty.
  std::function<void(const absl::Status& why)> on_away;
};

class Connection {
 public:
  // Asks the server about itself, with the patience of every call. Errors: InvalidArgument for an AddressProblem;
  // Unavailable says which address does not answer and how to start a server; Unimplemented when something else answers
  // there.
  static absl::StatusOr<std::unique_ptr<Connection>> Open(const ConnectionOptions& options);

  const ConnectionOptions& options() const { return options_; }
  const v1::ServerInfo& server() const { return server_; }

  v1::SequenceService::StubInterface& sequences() { return *sequences_; }
  v1::JobService::StubInterface& jobs() { return *jobs_; }
  v1::OutputService::StubInterface& outputs() { return *outputs_; }
  v1::AdminService::StubInterface& admin() { return *admin_; }

  // One call, retried while the server is unreachable:
  //   connection.Call(connection.jobs(), &v1::JobService::StubInterface::GetJob, request)
  template <typename Stub, typename Request, typename Response>
  absl::StatusOr<Response> Call(Stub& stub,
                                grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                                const Request& request) {
    return CallWithin(options_.call_timeout, stub, method, request);
  }
  // The same for a call that deletes. An answer may be lost on the way, so NotFound after an unanswered try is success.
  template <typename Stub, typename Request, typename Response>
  absl::Status Remove(Stub& stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                      const Request& request) {
    bool unanswered = false;
    const absl::Status status = CallWithin(options_.call_timeout, stub, method, request, &unanswered).status();
    return unanswered && absl::IsNotFound(status) ? absl::OkStatus() : status;
  }

  // Adds the token, if there is one. For calls that are not made by Call or Remove.
  void Authorize(grpc::ClientContext& context) const;
  // For work of more than one call that can be retried as well.
  Backoff NewBackoff() const { return Backoff(options_.patience, options_.on_away); }
  // The status of a call to this server; Unavailable names the address and what to do.
  absl::Status Answer(const grpc::Status& status) const;

 private:
  explicit Connection(ConnectionOptions options);

  // Each try may take `timeout`. `unanswered` is set if one may have got through without an answer.
  template <typename Stub, typename Request, typename Response>
  absl::StatusOr<Response> CallWithin(std::chrono::milliseconds timeout, Stub& stub,
                                      grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                                      const Request& request, bool* unanswered = nullptr) {
    for (Backoff backoff = NewBackoff();;) {
      grpc::ClientContext context;
      Authorize(context);
      context.set_deadline(std::chrono::system_clock::now() + timeout);
      Response response;
      const absl::Status status = Answer((stub.*method)(&context, request, &response));
      if (status.ok()) return response;
      if (!IsTransient(status) || !backoff.Wait(status)) return status;
      if (unanswered != nullptr && absl::IsUnavailable(status)) *unanswered = true;
    }
  }

  const ConnectionOptions options_;
  const std::shared_ptr<grpc::Channel> channel_;
  const std::unique_ptr<v1::AdminService::Stub> admin_;
  const std::unique_ptr<v1::SequenceService::Stub> sequences_;
  const std::unique_ptr<v1::JobService::Stub> jobs_;
  const std::unique_ptr<v1::OutputService::Stub> outputs_;
  v1::ServerInfo server_;
};

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_CONNECTION_H_
