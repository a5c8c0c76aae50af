// Clocks: what a stream's time stamps say about its own, and how the depth camera's is told from the colour camera's.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
#define DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_

#include <cstdint>
#include <utility>
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
// A rolling shutter exposes the rows of a colour frame one after the other; the time of a colour frame here is that of
// its middle row, so a camera that stamps its first row has half of its readout in `offset`.
struct ClockModel {
  int64_t reference_ns = 0;      // on the colour clock
  double offset_ns = 0.0;        // how far the depth clock is ahead at `reference_ns`
  double drift_ppm = 0.0;        // microseconds that the depth clock gains in a second
  double row_time_ns = 0.0;      // from one row of a colour frame to the one below it; 0 = all at once
  double offset_sigma_ns = 0.0;  // standard deviations; 0 = given, not estimated
  double drift_sigma_ppm = 0.0;
  double row_time_sigma_ns = 0.0;

  // The colour clock's time of a depth stamp, to the nearest nanosecond; exactly the stamp for offset and drift of 0.
  int64_t ColorTime(int64_t depth_stamp_ns) const;
  // The offset at another time.
  double OffsetAt(int64_t color_time_ns) const;
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

// A view of `source` with corrected stamps: intervals, keys and evaluation follow from them. Borrows `source`.
class CorrectedClock : public FrameSource {
 public:
  CorrectedClock(const FrameSource& source, const ClockModel& clock)
      : source_(source), sequence_(CorrectDepthStamps(source.sequence(), clock)) {}
  static CorrectedClock PairedByIndex(const FrameSource& source, int color_per_depth) {
    return {source, PairDepthByIndex(source.sequence(), color_per_depth)};
  }
  const Sequence& sequence() const override { return sequence_; }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override { return source_.Color(index); }
  absl::StatusOr<Image<float>> Depth(int index) const override { return source_.Depth(index); }

 private:
  CorrectedClock(const FrameSource& source, Sequence sequence) : source_(source), sequence_(std::move(sequence)) {}

  const FrameSource& source_;
  const Sequence sequence_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_CLOCK_H_
