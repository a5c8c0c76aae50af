// What a stream's time stamps say about its clock.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
#define DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_

#include <cstdint>
#include <vector>

#include "core/sequence/sequence.h"

namespace depthtween {

// Standard deviation of one stamp about a regular clock, nanoseconds: stamps taken when a frame arrives wander with the
// bus and the operating system. Robust to dropped frames (a gap may be any multiple of the period). 0 for fewer than 4
// frames.
int64_t StampJitterNs(const std::vector<FrameRef>& frames);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
