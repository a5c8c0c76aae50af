// A finished result beside the recording it was made from.
#ifndef DEPTHTWEEN_CORE_SESSION_FINISHED_CLIP_H_
#define DEPTHTWEEN_CORE_SESSION_FINISHED_CLIP_H_

#include <memory>
#include <string>

#include "core/base/status.h"
#include "core/io/result_folder.h"
#include "core/io/sequence_folder.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

struct FinishedClip {
  ResultFolder result;
  std::unique_ptr<SequenceFolder> recording;
  Sequence input;  // the recording as the upsampling saw it: its clock, and without the depth frames it left out
  ClipConstants constants;

  int frame_count() const { return static_cast<int>(input.color.size()); }
  int64_t start_ns() const { return input.color.front().time_ns; }
};

// `sequence` is where the recording is; empty: where the report says it was, which that of a server's job does not.
// InvalidArgument when it is not said, when they do not belong together, or when the report is not what upsample wrote.
absl::StatusOr<FinishedClip> OpenFinishedClip(const std::string& result, const std::string& sequence);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_FINISHED_CLIP_H_
