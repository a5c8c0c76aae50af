// RenderFrame: one picture, rendered by a child process while the call waits without holding a thread.
#ifndef DEPTHTWEEN_SERVER_RPC_FRAME_RENDER_STREAM_H_
#define DEPTHTWEEN_SERVER_RPC_FRAME_RENDER_STREAM_H_

#include <memory>
#include <string>

#include "depthtween/v1/output.pb.h"
#include "server/jobs/job_manager.h"
#include "server/rpc/frame_chunks.h"
#include "server/rpc/server_stream.h"

namespace depthtween::server {

class FrameRenderStream : public ServerStream<v1::FrameChunk> {
 public:
  FrameRenderStream(CallRuntime& runtime, grpc::CallbackServerContext* context, JobManager& jobs,
                    const v1::RenderFrameRequest& request);

 private:
  absl::StatusOr<Next> Produce() override;
  // A client that is gone, or a server that stops, ends the child.
  void Release() override { errand_.reset(); }
  // Checks the request and begins to render.
  absl::Status Begin();

  JobManager& jobs_;
  const v1::RenderFrameRequest request_;
  std::string job_id_;
  std::unique_ptr<Errand> errand_;
  v1::FrameHeader header_;
  FrameChunks chunks_;
  bool answered_ = false;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_FRAME_RENDER_STREAM_H_
