// A colour frame as depth edges are compared with it: where it changes, and how it moves.
//
// Units: pixels, milliseconds, 8-bit levels.  Threads: a MovingPicture is a value; a ColorReader is for one thread.
#ifndef DEPTHTWEEN_CORE_CAPTURE_MOVING_PICTURE_H_
#define DEPTHTWEEN_CORE_CAPTURE_MOVING_PICTURE_H_

#include <array>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/capture/depth_edges.h"
#include "core/flow/dense_flow.h"
#include "core/sequence/sequence.h"

namespace depthtween {

inline double Milliseconds(int64_t ns) { return 1e-6 * static_cast<double>(ns); }

// The colour frame nearest in time; the earlier of two. There must be one.
int NearestColor(const Sequence& sequence, int64_t time_ns);

class MovingPicture {
 public:
  // The flow is that of one step to another frame, `step_ms` later (or, if negative, earlier). Errors: of DenseFlow.
  static absl::StatusOr<MovingPicture> Make(ImageView<const Rgb8> here, ImageView<const Rgb8> there, double step_ms,
                                            const DenseFlowOptions& options);

  // The squared change of colour across a place in the direction (nx, ny) of unit length, summed over the channels.
  float Contrast2(float x, float y, float nx, float ny) const;
  // Whether a place is at least `margin` pixels inside.
  bool Contains(float x, float y, float margin) const;

  struct Moved {
    float x, y;                    // where the edge is seen in this frame
    float velocity_x, velocity_y;  // of the nearer surface, pixels per millisecond
  };
  // An edge that was seen `ms` before this frame.
  Moved Move(const DepthEdge& edge, double ms) const;

 private:
  // Smoothed by (1 2 1)/4 both ways: an edge then has a slope to interpolate, and noise counts less.
  std::array<Image<float>, 3> channels_;
  Image<Flow2> flow_;
  float per_ms_ = 0.0F;  // times flow_: velocity
};

// What noise makes of Contrast2, and where a change begins to count: 8 levels in each channel, an ordinary camera's
// noise after compression.
inline constexpr float kNoiseContrast2 = 3 * 64.0F;

// Colour frames with their motion to the next one (the last: to the one before). Keeps the last frames read, so that
// walking over neighbours reads each once. Borrows the source, which has at least two colour frames.
class ColorReader {
 public:
  explicit ColorReader(const FrameSource& source) : source_(source) {}
  absl::StatusOr<MovingPicture> Read(int index, const DenseFlowOptions& options);

 private:
  absl::Status Hold(int slot, int index);
  const FrameSource& source_;
  std::array<int, 2> held_ = {-1, -1};  // frame i is in slot i % 2
  std::array<Image<Rgb8>, 2> images_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_CAPTURE_MOVING_PICTURE_H_
