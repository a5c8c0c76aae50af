// Clocks: what a stream's time stamps say about its own, and how the depth camera's is told from the colour camera's.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
#define DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_

#include <cstdint>
#include <string_view>
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

// What a user may ask of a clock, as text of at most 64 bytes:
//   stamps                    the stamps of the depth frames are right
//   index                     they mean nothing: depth frame k was taken with colour frame k x ratio of the rates
//   estimate                  measured from the images; where they do not tell, the stamps are kept
//   OFFSET_MS[,DRIFT_PPM]     the depth clock is OFFSET_MS ahead at the first colour frame and gains DRIFT_PPM
struct ClockChoice {
  enum class Mode { kStamps, kIndex, kEstimate, kGiven };
  Mode mode = Mode::kStamps;
  double offset_ms = 0.0, drift_ppm = 0.0;  // kGiven
};

// InvalidArgument names what may stand there.
absl::StatusOr<ClockChoice> ParseClockChoice(std::string_view text);

// The depth frames of `sequence` stamped by the colour camera's clock. `clock` must be valid.
Sequence CorrectDepthStamps(const Sequence& sequence, const ClockModel& clock);

// Where the jitter of both streams' stamps explains how far depth frames are from colour frames - half of them by two
// deviations at most, nearly all by four - they were taken with these and get their stamps: to move depth by a stamp's
// error would only add that error. Else only those do that are within a fiftieth of the colour frames' period. Stamps
// still ascend: where two would get one, neither does. `sequence` must be valid.
Sequence PairDepthWithinJitter(const Sequence& sequence);

// Ignores the stamps of depth frames: frame k is taken with colour frame k * `color_per_depth` (>= 1). Depth frames
// beyond the last colour frame are left out.
Sequence PairDepthByIndex(const Sequence& sequence, int color_per_depth);
// How many colour frames there are for one of depth, by the streams' median periods: at least 1.
int ColorFramesPerDepth(const Sequence& sequence);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
