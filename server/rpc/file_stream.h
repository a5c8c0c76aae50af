// ReadOutput: the bytes of an output that is one file, from any position on.
#ifndef DEPTHTWEEN_SERVER_RPC_FILE_STREAM_H_
#define DEPTHTWEEN_SERVER_RPC_FILE_STREAM_H_

#include <cstdint>
#include <optional>
#include <string>

#include "depthtween/v1/output.pb.h"
#include "server/jobs/job_manager.h"
#include "server/rpc/server_stream.h"

namespace depthtween::server {

class FileStream : public ServerStream<v1::ReadOutputResponse> {
 public:
  FileStream(CallRuntime& runtime, grpc::CallbackServerContext* context, JobManager& jobs,
             const v1::ReadOutputRequest& request);
  ~FileStream() override;

 private:
  absl::StatusOr<Next> Produce() override;
  // Checks the request and opens the file. DataLoss (FILE_LOST) if it is gone.
  absl::Status Open();
  // The error FILE_DAMAGED, unless the job is being deleted.
  absl::Status Damaged();

  JobManager& jobs_;
  const v1::ReadOutputRequest request_;
  int descriptor_ = -1;  // held, so that all bytes come from one file even if the job is retried meanwhile
  std::string job_id_;
  OutputSpec output_{};
  std::optional<FileChecksum> checksum_;  // of the file; none if it was made before there were any
  int64_t size_bytes_ = 0;
  int64_t position_ = 0;
  int64_t end_ = 0;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_FILE_STREAM_H_
