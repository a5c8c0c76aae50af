// StreamFrames: the frames of one output in the order of time, each as soon as it is stored.
//
// Between two messages a stream holds one encoded frame, the two messages of its base class, and nothing else: no
// thread, no transaction, no file.
#ifndef DEPTHTWEEN_SERVER_RPC_FRAME_STREAM_H_
#define DEPTHTWEEN_SERVER_RPC_FRAME_STREAM_H_

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "depthtween/v1/output.pb.h"
#include "server/jobs/job_manager.h"
#include "server/rpc/frame_chunks.h"
#include "server/rpc/server_stream.h"

namespace depthtween::server {

// The memory that the buffers of all streams of frames may take together.
class FrameMemory {
 public:
  explicit FrameMemory(int64_t limit_bytes) : limit_bytes_(limit_bytes) {}
  // False, taking nothing, when that would exceed the limit.
  bool Take(int64_t bytes);
  void Give(int64_t bytes) { taken_bytes_ -= bytes; }

 private:
  const int64_t limit_bytes_;
  std::atomic<int64_t> taken_bytes_ = 0;
};

class FrameStream : public ServerStream<v1::FrameChunk> {
 public:
  FrameStream(CallRuntime& runtime, grpc::CallbackServerContext* context, JobManager& jobs, FrameMemory& memory,
              const v1::StreamFramesRequest& request);
  ~FrameStream() override;

 private:
  absl::StatusOr<Next> Produce() override;
  void Release() override { watch_.reset(); }

  // Checks the request and learns about the job.
  absl::Status Open();
  // Reads the job's events; only when following.
  absl::Status CatchUp();
  // The next frame wanted if it can be read now. nullopt if there is none (yet).
  absl::StatusOr<std::optional<FrameRecord>> NextReady();
  absl::Status Load(const FrameRecord& frame);
  bool AtEndFrame() const;
  // How the stream ends when no further frame can be read.
  absl::StatusOr<Next> EndOrWait() const;

  JobManager& jobs_;
  FrameMemory& memory_;
  const v1::StreamFramesRequest request_;
  const int stride_;

  std::string job_id_;
  std::optional<OutputSpec> output_;
  v1::Encoding encoding_ = v1::ENCODING_UNSPECIFIED;
  JobRecord job_;
  int64_t memory_taken_ = 0;
  std::unique_ptr<JobWatch> watch_;

  int next_frame_;                    // the first one not yet loaded
  std::deque<FrameRecord> upcoming_;  // ready ones from next_frame_ on, read from the store in one go
  FrameChunks chunks_;                // of the frame being sent
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_FRAME_STREAM_H_
