// Motion of the window's frames: from neighbour to neighbour, and from each frame to both keys.
//
// Shapes:   all images W x H.  Units: pixels.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_TRACKS_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_TRACKS_H_

#include <array>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/upsample/stage_runner.h"
#include "core/upsample/window.h"

namespace depthtween {

// [i]: between frames i and i + 1 of the window. Empty images where nobody needs the flow.
struct NeighbourFlow {
  std::vector<Image<Flow2>> forward, backward;
};

// `everywhere`: between all neighbours; else only where a key lies between two colour frames. `recover`: the motion of
// small, fast things that coarse-to-fine flow loses is searched for as well.
absl::StatusOr<NeighbourFlow> FlowBetweenNeighbours(const Window& window, bool everywhere, bool recover,
                                                    const StageRunner& run);

// [side][frame of the window]: motion to the key. Images may be empty: no such proposal.
using Tracks = std::array<std::vector<Image<Flow2>>, 2>;
Tracks NoTracks(const Window& window);

struct KeyTracks {
  Tracks composed;  // from neighbour to neighbour
  Tracks refined;   // directly against the key, starting from there
};

// Composed step by step outward from the key, then refined directly.
absl::StatusOr<KeyTracks> ComposeAndRefine(const Window& window, const NeighbourFlow& flow, int finest_scale,
                                           const StageRunner& run);

// Frame by frame outward from the key, each flow starting where the last one leads: half the flows. `composed` stays
// empty. What one frame gets wrong the next starts from: with the coarser search that does for refining, errors are up
// to 15 % higher where motion is fast.
absl::StatusOr<KeyTracks> FollowOutward(const Window& window, int finest_scale, const StageRunner& run);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_TRACKS_H_
