// How a clip is cut into independent pieces of work.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_INTERVAL_H_
#define DEPTHTWEEN_CORE_SEQUENCE_INTERVAL_H_

#include <vector>

#include "core/sequence/sequence.h"

namespace depthtween {

// The colour frames between two neighbouring depth frames. A depth frame that is input is called a key.
// Every colour frame of a sequence belongs to exactly one interval; intervals follow one another in time.
struct Interval {
  int index = -1;
  int key_before = -1;  // into Sequence::depth; -1: these colour frames come before the first key
  int key_after = -1;   // into Sequence::depth; -1: these colour frames come after the last key
  int first_frame = 0;  // into Sequence::color
  int frame_count = 0;  // > 0

  bool Held() const { return key_before < 0 || key_after < 0; }
};

// Frames with key time t_k <= t < t_{k+1} belong to the interval k..k+1; the frame at exactly the last key's time
// belongs to the last two-key interval. Frames before the first and after the last key form a held interval each.
// Intervals without frames are left out. `sequence` must be valid.
std::vector<Interval> PlanIntervals(const Sequence& sequence);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_INTERVAL_H_
