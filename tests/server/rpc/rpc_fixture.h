// A whole server on a temporary data directory, with the fake depthtween-core as its children, and clients that reach
// it without a network.
#ifndef DEPTHTWEEN_TESTS_SERVER_RPC_RPC_FIXTURE_H_
#define DEPTHTWEEN_TESTS_SERVER_RPC_RPC_FIXTURE_H_

#include <gmock/gmock.h>
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/support/status.h>
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "depthtween/v1/job.grpc.pb.h"
#include "depthtween/v1/output.grpc.pb.h"
#include "depthtween/v1/sequence.grpc.pb.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/sequences.h"
#include "server/rpc/rpc_server.h"
#include "server/store/data_directory.h"
#include "server/store/folder_blob_store.h"
#include "server/store/sqlite_store.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {

// The detail of this kind that a status carries, if any.
template <typename Message>
std::optional<Message> Detail(const grpc::Status& status) {
  google::rpc::Status details;
  details.ParseFromString(status.error_details());
  for (const auto& any : details.details()) {
    if (Message message; any.UnpackTo(&message)) return message;
  }
  return std::nullopt;
}

// A status with this code, and an ErrorInfo of our domain with this reason.
MATCHER_P2(Fails, code, reason, "fails with that code and reason") {
  const auto info = Detail<google::rpc::ErrorInfo>(arg);
  *result_listener << "which is code " << arg.error_code() << " (" << (info ? info->reason() : "no ErrorInfo") << ") "
                   << arg.error_message();
  return arg.error_code() == code && info && info->domain() == "depthtween" && info->reason() == reason;
}

MATCHER(Succeeds, "is OK") {
  *result_listener << "which is code " << arg.error_code() << " " << arg.error_message();
  return arg.ok();
}

// INVALID_ARGUMENT with a BadRequest about this field.
MATCHER_P(FailsAtField, field, "is INVALID_ARGUMENT about that field") {
  const auto bad_request = Detail<google::rpc::BadRequest>(arg);
  *result_listener << "which is code " << arg.error_code() << " " << arg.error_message();
  return arg.error_code() == grpc::INVALID_ARGUMENT && bad_request && bad_request->field_violations_size() == 1 &&
         bad_request->field_violations(0).field() == field;
}

class RpcTest : public testing::Test {
 protected:
  RpcTest();
  ~RpcTest() override;

  // Before the first use of a stub, if at all.
  RpcServerOptions rpc_options = {.listen = "127.0.0.1:0", .call_threads = 4};
  JobManagerOptions job_options;
  Limits limits;
  GuardOptions guard_options;

  // Starts the server if it does not run.
  RpcServer& server();
  void StopServer(absl::Duration patience = absl::Seconds(60)) { server_->Stop(patience); }
  // A second one beside it, on the same data.
  absl::StatusOr<std::unique_ptr<RpcServer>> StartAnother(const RpcServerOptions& options);
  JobManager& jobs() { return server(), *jobs_; }
  const DataDirectory& directory() { return server(), *directory_; }
  std::shared_ptr<grpc::Channel> channel() { return server().InProcessChannel(); }
  v1::SequenceService::Stub& sequences_stub();
  v1::JobService::Stub& jobs_stub();
  v1::OutputService::Stub& outputs_stub();
  const Health& health() const { return health_; }

  // ---- what tests need before they come to the point ----
  v1::Sequence CreateSequence(const std::string& display_name = "");
  v1::Upload StartUpload(const std::string& sequence, const std::map<std::string, std::string>& files);
  // Writes `bytes` from `offset` on in messages of `chunk` bytes and finishes.
  grpc::Status WriteUpload(const std::string& upload, std::string_view bytes, int64_t offset, size_t chunk, bool finish,
                           v1::Upload* response);
  // A READY sequence whose children behave as the script says, see tests/server/jobs/fake_core.cc.
  v1::Sequence ReadySequence(const std::string& script = "");
  // Lets a child go on where its script says wait_at.
  void Go(const v1::Sequence& sequence);
  v1::Job CreateJob(const v1::Sequence& sequence);
  v1::Job GetJob(const std::string& job);
  v1::Job WaitUntilEnded(const std::string& job);
  // Has the store forget the checksums of the job's files, as if an older version had made them: the test puts others
  // in their place.
  void ForgetChecksums(const v1::Job& job);

 private:
  TemporaryFolder folder_;
  std::unique_ptr<DataDirectory> directory_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<BlobStore> blobs_;
  std::unique_ptr<JobManager> jobs_;
  std::unique_ptr<Sequences> sequences_;
  std::unique_ptr<Collector> collector_;
  std::unique_ptr<Upkeep> upkeep_;
  std::unique_ptr<Guard> guard_;
  Health health_;
  std::unique_ptr<RpcServer> server_;
  std::unique_ptr<v1::SequenceService::Stub> sequences_stub_;
  std::unique_ptr<v1::JobService::Stub> jobs_stub_;
  std::unique_ptr<v1::OutputService::Stub> outputs_stub_;
};

// The id in a name of one level.
inline std::string IdOf(const std::string& name) { return name.substr(name.find('/') + 1); }
// The bytes of all files, in the order in which StartUpload announces them.
std::string Concatenate(const std::map<std::string, std::string>& files);
// The same bytes for the same seed.
std::string RandomBytes(size_t count, unsigned seed);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_RPC_RPC_FIXTURE_H_
