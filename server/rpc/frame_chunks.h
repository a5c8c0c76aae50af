// Cuts one encoded frame into the chunks that carry it.
#ifndef DEPTHTWEEN_SERVER_RPC_FRAME_CHUNKS_H_
#define DEPTHTWEEN_SERVER_RPC_FRAME_CHUNKS_H_

#include <string>

#include "depthtween/v1/output.pb.h"

namespace depthtween::server {

// Load (Fill)* until empty(), then Load the next.
class FrameChunks {
 public:
  // `header` lacks only what follows from the bytes: size and checksum. `next_frame` continues after this one.
  void Load(int frame, v1::FrameHeader header, std::string bytes, int next_frame);
  // Nothing is left to send.
  bool empty() const { return sent_ == bytes_.size(); }
  // Frees the memory of the frame that was sent.
  void Clear();
  // The next chunk. Not when empty().
  void Fill(v1::FrameChunk& chunk);

 private:
  v1::FrameHeader header_;
  std::string bytes_;
  size_t sent_ = 0;
  int frame_ = 0;
  int next_frame_ = 0;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_FRAME_CHUNKS_H_
