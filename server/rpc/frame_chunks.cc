#include "server/rpc/frame_chunks.h"

#include <string_view>
#include <utility>

#include "proto/depthtween/crc32c.h"
#include "server/telemetry/metrics.h"

namespace depthtween::server {
namespace {

constexpr size_t kMessageBytes = 256 << 10;  // a small part of the 4 MiB of a message; larger ones gain nothing

}  // namespace

void FrameChunks::Load(int frame, v1::FrameHeader header, std::string bytes, int next_frame) {
  bytes_ = std::move(bytes);
  sent_ = 0;
  frame_ = frame;
  next_frame_ = next_frame;
  header_ = std::move(header);
  header_.set_size_bytes(static_cast<int64_t>(bytes_.size()));
  header_.set_crc32c(Crc32c(bytes_));
}

void FrameChunks::Clear() {
  std::string().swap(bytes_);
  sent_ = 0;
}

void FrameChunks::Fill(v1::FrameChunk& chunk) {
  if (sent_ == 0) {
    *chunk.mutable_header() = header_;
  } else {
    chunk.clear_header();
  }
  chunk.set_frame(frame_);
  chunk.set_offset(static_cast<int64_t>(sent_));
  if (bytes_.size() <= kMessageBytes) {  // one message: neither copied nor summed again
    chunk.set_data(std::move(bytes_));
    Clear();
    chunk.set_crc32c(header_.crc32c());
  } else {
    const std::string_view data = std::string_view(bytes_).substr(sent_, kMessageBytes);
    chunk.set_data(data.data(), data.size());
    chunk.set_crc32c(Crc32c(data));
    sent_ += data.size();
  }
  CountBytes("out", static_cast<int64_t>(chunk.data().size()));
  if (empty()) {
    chunk.set_next_frame(next_frame_);
  } else {
    chunk.clear_next_frame();
  }
}

}  // namespace depthtween::server
