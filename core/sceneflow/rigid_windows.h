// Our scene flow: dense flow proposes, rigid motions of windows of a surface explain, every pixel chooses.
//
// 1. Dense flow both ways; where it returns to where it started, pixel and depth at its end are a match.
// 2. Rigid motions are fitted robustly to the matches of windows that keep to one surface: small ones that follow what
//    bends, large ones that average noise, and the few that dominate the whole frame. Windows with too few matches, as
//    where a surface is hidden, take over the motion of their neighbours on the same surface.
//    Range flow and recovered motion (core/flow/lost_motion.h) propose more candidates for windows that these do not
//    explain; they have no vote.
// 3. Every pixel compares these motions, and its own match, by colour, by the depth measured where they lead, and by
//    the flow; a motion that leads behind the measured depth means that the pixel becomes occluded, which costs a fixed
//    amount. The simpler motion wins unless the other is better by more than chance. Then motions spread between
//    neighbours.
//    Steps 1 to 3 run twice; the second time flow starts from what the first chose.
// 4. Motions of neighbours that agree are averaged.
//
// Source:   windows of rigid motion: Hornacek, Fitzgibbon and Rother, SphereFlow, CVPR 2014; dominant motions first:
//           Quiroga et al., Dense Semi-rigid Scene Flow Estimation from RGBD Images, ECCV 2014. We fit to matches
//           instead of searching, and let hidden pixels take part.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_RIGID_WINDOWS_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_RIGID_WINDOWS_H_

#include "core/sceneflow/frame_pair.h"

namespace depthtween {

// Every pixel gets an answer. Cancelled when `pair.stop` fires. Uses up to `pair.threads` threads; the result does not
// depend on how many.
absl::StatusOr<SceneFlow> RigidWindowsFlow(const FramePair& pair);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_RIGID_WINDOWS_H_
