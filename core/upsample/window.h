// The frames that one interval looks at: its own colour frames, those of its two keys, and what the keys measured.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_WINDOW_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_WINDOW_H_

#include <array>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/sequence/interval.h"
#include "core/sequence/sequence.h"
#include "core/upsample/keys.h"
#include "core/upsample/stage_runner.h"

namespace depthtween {

// Frames are counted from the first of the window; targets, the frames of the interval, from the first of these. Sides:
// the key before [0] and the key after [1].
struct Window {
  int first = 0;  // into Sequence::color
  std::vector<Image<Rgb8>> color;
  std::vector<Image<uint8_t>> luma;
  std::vector<float> tau;                  // time between the keys, 0..1; stamps decide, not indices
  std::array<Key, 2> located;              // the keys, still without images
  std::array<Image<float>, 2> measured_m;  // their depth, as it was read
  int first_target = 0, target_count = 0;

  int size() const { return static_cast<int>(color.size()); }
  int Target(int i) const { return first_target + i; }
  int KeyFrame(int side) const { return located[side].color_index - first; }
  int ThreadsPerTarget(int threads) const;
};

// Reads them. `interval` must have both keys. Errors: those of `source`; Cancelled.
absl::StatusOr<Window> ReadWindow(const FrameSource& source, const Interval& interval, const StageRunner& run);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_WINDOW_H_
