// What lies behind the nearest layer near depth edges: another eye sees past an edge, and so does a wide lens.
//
// Shapes:   all images W x H of the view.  Units: metres along z, 0 = unknown; distances and motion in pixels.
// Threads:  safe to call concurrently; `threads` only splits rows, results do not depend on it.
#ifndef DEPTHTWEEN_CORE_RENDER_HIDDEN_BACKGROUND_H_
#define DEPTHTWEEN_CORE_RENDER_HIDDEN_BACKGROUND_H_

#include <cstdint>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/render/render_view.h"

namespace depthtween {

// Another frame of the recording, and where the pixels of the centre frame are in it.
struct NeighborFrame {
  RenderView view;
  ImageView<const Flow2> motion;  // from the centre frame to this one
};

// Where hidden pixels come from; 0 = nothing was looked for.
inline constexpr uint8_t kHiddenSeen = 1;      // seen in another frame
inline constexpr uint8_t kHiddenInferred = 2;  // continued from the same layer around

struct HiddenBackground {
  Image<Rgb8> color;
  Image<float> depth_m;   // 0 where nothing was looked for
  Image<uint8_t> source;  // kHiddenSeen, kHiddenInferred or 0
};

// Behind which edges of the foreground to look. An eye further left sees past left edges, and only along the row.
enum class EdgeSides { kAllAround, kLeft, kRight, kLeftAndRight };

struct HiddenBackgroundOptions {
  EdgeSides sides = EdgeSides::kAllAround;
  int reach_px = 32;        // how far from an edge into the foreground, 1..256
  int guard_px = 1;         // background this near to an edge may carry foreground colour: not trusted, 0..8
  float layer_gap = 0.04F;  // an edge is where the nearer depth lies this share before the farther one, (0, 0.5]

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// Looks behind every depth edge of `view`: on the foreground's side up to `reach_px`, at a depth that continues the
// layer behind the edge; and on the `guard_px` pixels of the background's side, where it is what the pixel would be if
// no foreground were mixed into it.
//
// A point that a neighbour sees (neighbours in order of preference) is taken from there: the motion of the background
// is continued under the foreground to find it, and the neighbour's depth must confirm it. The rest is inferred from
// trusted pixels of the same layer, by pull-push and by lines that go on. No pixel of a nearer layer ever contributes
// colour. `options` must validate; neighbours have the size of the view.
HiddenBackground FindHiddenBackground(const RenderView& view, const std::vector<NeighborFrame>& neighbors,
                                      const HiddenBackgroundOptions& options, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_HIDDEN_BACKGROUND_H_
