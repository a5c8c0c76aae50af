// The bytes of a stored frame in the encoding that a client asked for.
#ifndef DEPTHTWEEN_SERVER_RPC_FRAME_ENCODING_H_
#define DEPTHTWEEN_SERVER_RPC_FRAME_ENCODING_H_

#include <cstdint>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "depthtween/v1/types.pb.h"
#include "server/jobs/job_manager.h"

namespace depthtween::server {

// What StreamFrames can be asked for; empty for an output that is not made of frames.
std::vector<v1::Encoding> EncodingsOf(OutputKind kind);

// The stored value that means unknown.
uint32_t InvalidValueOf(OutputKind kind);

// `png` is the stored file; `encoding` one of EncodingsOf(kind). Lossless: every encoding decodes to the same numbers.
// Errors: DataLoss if the stored file is damaged.
absl::StatusOr<std::string> EncodeFrame(std::string png, OutputKind kind, v1::Encoding encoding,
                                        double units_per_metre);

// The most memory that EncodeFrame and its result take, for a frame of that many pixels.
int64_t FrameMemoryBytes(int64_t pixels);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_FRAME_ENCODING_H_
