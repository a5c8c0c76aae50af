// Clocks: what a stream's time stamps say about its own, and how the depth camera's is told from the colour camera's.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
#define DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_

#include <cstdint>
#include <vector>

#include "core/base/status.h"
#include "core/sequence/sequence.h"

namespace depthtween {

// Standard deviation of one stamp about a regular clock, nanoseconds: stamps taken when a frame arrives wander with the
// bus and the operating system. Robust to dropped frames (a gap may be any multiple of the period). 0 for fewer than 4
// frames.
int64_t StampJitterNs(const std::vector<FrameRef>& frames);
// The median gap between stamps, nanoseconds; 0 for fewer than 2 frames.
int64_t MedianPeriodNs(const std::vector<FrameRef>& frames);

// The depth camera's clock against the colour camera's: when the colour clock shows t, the depth clock shows
//   t + offset + drift (t - reference).
struct ClockModel {
  int64_t reference_ns = 0;  // on the colour clock
  double offset_ns = 0.0;    // how far the depth clock is ahead at `reference_ns`
  double drift_ppm = 0.0;    // microseconds that the depth clock gains in a second

  // The colour clock's time of a depth stamp, to the nearest nanosecond; exactly the stamp for offset and drift of 0.
  int64_t ColorTime(int64_t depth_stamp_ns) const;
  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// The depth frames of `sequence` stamped by the colour camera's clock. `clock` must be valid.
Sequence CorrectDepthStamps(const Sequence& sequence, const ClockModel& clock);

// Ignores the stamps of depth frames: frame k is taken with colour frame k * `color_per_depth` (>= 1). Depth frames
// beyond the last colour frame are left out.
Sequence PairDepthByIndex(const Sequence& sequence, int color_per_depth);
// How many colour frames there are for one of depth, by the streams' median periods: at least 1.
int ColorFramesPerDepth(const Sequence& sequence);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
