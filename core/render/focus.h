// Where a lens is focused in each frame: at a depth, at what is seen at a pixel, on a point that is followed, or from
// depth to depth.
//
// Units: depth in metres along z; places in pixels, which need not be whole. Threads: all functions are pure.
#ifndef DEPTHTWEEN_CORE_RENDER_FOCUS_H_
#define DEPTHTWEEN_CORE_RENDER_FOCUS_H_

#include <variant>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"

namespace depthtween {

struct FocusMedian {};  // at the median depth of the clip

struct FocusDepth {
  double depth_m = 0.0;
};

// At the depth of what this frame shows there, in all frames the same.
struct FocusPixel {
  int frame = 0;
  double x = 0.0, y = 0.0;
};

// On what `start` shows, before and after it too, wherever it moves.
struct FocusTrack {
  FocusPixel start;
};

struct FocusKey {
  int frame = 0;
  double depth_m = 0.0;
};
enum class FocusEasing {
  kSmooth,  // sets off and arrives gently
  kLinear,
};
struct FocusKeys {
  std::vector<FocusKey> keys;  // at least one, frames ascending, depths positive
  FocusEasing easing = FocusEasing::kSmooth;
};

using FocusOptions = std::variant<FocusMedian, FocusDepth, FocusPixel, FocusTrack, FocusKeys>;

// Between keys blur, and so inverse depth, changes evenly or eased; before the first and after the last it rests.
double FocusDepthOf(const FocusKeys& keys, int frame);

// A followed point at one frame: all there is to know in order to follow it on.
struct FocusPoint {
  int frame = 0;
  double x = 0.0, y = 0.0;
  double depth_m = 0.0;
};

// The nearest surface at or right beside a pixel, since who points at a thin thing means it. NotFound if no depth is
// known around it; InvalidArgument if the pixel lies outside the image.
absl::StatusOr<FocusPoint> StartFocus(const FocusPixel& pixel, ImageView<const float> depth_m);

// The point in a neighbouring frame. `motion` leads there from the point's own frame, whose depth is `depth_m`; it may
// be empty: then the point is looked for where it was. It keeps to its surface, as told by depth. Where it is hidden or
// outside the image it waits with its depth unchanged, and resumes when its surface comes back.
FocusPoint FollowFocus(const FocusPoint& point, ImageView<const float> depth_m, ImageView<const Flow2> motion,
                       int next_frame, ImageView<const float> next_depth_m);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_FOCUS_H_
