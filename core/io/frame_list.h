// rgb.txt and depth.txt of a sequence folder: `timestamp filename` per line, seconds, `#` comments (the TUM RGB-D
// layout).
#ifndef DEPTHTWEEN_CORE_IO_FRAME_LIST_H_
#define DEPTHTWEEN_CORE_IO_FRAME_LIST_H_

#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/sequence/sequence.h"

namespace depthtween {

inline constexpr int kMaxListedFrames = 100000;  // per list; a longer recording is cut by its owner

// A name that may stand in a list, be uploaded, and become a path below the sequence folder: relative, without `..`,
// `.`, empty parts, backslashes or control characters, valid UTF-8, at most 1024 bytes. InvalidArgument otherwise.
absl::Status CheckFrameName(std::string_view name);

// Frames in the order of the list, and one status for every line that is wrong. Whether time goes forward is for
// Violations(Sequence) to say. A file listed twice is wrong, and so are two files of one stem: a result is named by it.
// Reading stops with ResourceExhausted past kMaxListedFrames.
struct FrameList {
  std::vector<FrameRef> frames;
  std::vector<absl::Status> problems;
};
FrameList ParseFrameList(std::string_view text);

// The inverse, with 9 decimals.
std::string FormatFrameList(const std::vector<FrameRef>& frames);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_FRAME_LIST_H_
