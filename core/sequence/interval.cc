#include "core/sequence/interval.h"

namespace depthtween {

std::vector<Interval> PlanIntervals(const Sequence& sequence) {
  const int keys = static_cast<int>(sequence.depth.size());
  std::vector<Interval> intervals;
  int after = 0;  // first key later than the current frame
  for (int frame = 0; frame < static_cast<int>(sequence.color.size()); ++frame) {
    const int64_t time = sequence.color[frame].time_ns;
    while (after < keys && sequence.depth[after].time_ns <= time) ++after;
    Interval here{.key_before = after - 1, .key_after = after < keys ? after : -1};
    const bool at_last_key = after == keys && keys >= 2 && sequence.depth.back().time_ns == time;
    if (at_last_key) here = {.key_before = keys - 2, .key_after = keys - 1};
    if (!intervals.empty() && intervals.back().key_before == here.key_before &&
        intervals.back().key_after == here.key_after) {
      ++intervals.back().frame_count;
      continue;
    }
    here.index = static_cast<int>(intervals.size());
    here.first_frame = frame;
    here.frame_count = 1;
    intervals.push_back(here);
  }
  return intervals;
}

}  // namespace depthtween
