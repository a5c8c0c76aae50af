// rgb.txt and depth.txt of a sequence folder: `timestamp filename` per line, seconds, `#` comments (the TUM RGB-D
// layout). Stamps in milliseconds, microseconds or nanoseconds are recognised (core/sequence/time_unit.h); the comment
// `# unit: s` (or ms, us, ns) says the unit. A byte-order mark of UTF-8 is skipped.
#ifndef DEPTHTWEEN_CORE_IO_FRAME_LIST_H_
#define DEPTHTWEEN_CORE_IO_FRAME_LIST_H_

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/sequence/sequence.h"
#include "core/sequence/time_unit.h"

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
  std::vector<Stamp> stamps;  // of the frames, as written
  TimeUnit unit = TimeUnit::kSeconds;
  bool unit_is_said = false;  // by the list; else it was told from the stamps
};
FrameList ParseFrameList(std::string_view text);

// Reads the stamps in another unit. InvalidArgument, and no change, when one lies beyond 292 years in it.
absl::Status SetTimeUnit(TimeUnit unit, FrameList& list);

// The inverse, in seconds with 9 decimals; says the unit where the stamps alone would be taken for another.
std::string FormatFrameList(const std::vector<FrameRef>& frames);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_FRAME_LIST_H_
