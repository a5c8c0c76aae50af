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

// The encodings that StreamFrames offers, first as it is stored; empty for an output that is not made of frames.
std::vector<v1::Encoding> EncodingsOf(const OutputSpec& output);

// The stored value that means unknown.
uint32_t InvalidValueOf(OutputKind kind);

// `stored` is the stored file; `encoding` one of EncodingsOf(output). Every encoding but JPEG decodes to the same
// numbers. Errors: DataLoss if the stored file is damaged.
absl::StatusOr<std::string> EncodeFrame(std::string stored, const OutputSpec& output, v1::Encoding encoding,
                                        double units_per_metre);

// The most memory that EncodeFrame and its result take, for a recording with frames of that many pixels.
int64_t FrameMemoryBytes(const OutputSpec& output, int64_t pixels);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_FRAME_ENCODING_H_
