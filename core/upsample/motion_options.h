// How motion is measured and trusted, in the pipeline and in its causal mode alike.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_MOTION_OPTIONS_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_MOTION_OPTIONS_H_

#include "core/flow/dense_flow.h"

namespace depthtween {

// Neighbour-to-neighbour flow only proposes and starts: half resolution is enough. The flow to a key decides edges.
// Variational refinement smooths across silhouettes what the choice among proposals has to tell apart: without it
// errors stay within 1 % (rotation: 1 % lower), and flow takes half the time.
inline constexpr DenseFlowOptions kNeighbourFlow{
    .finest_scale = 1, .patch_stride = 4, .descent_iterations = 16, .refinement_iterations = 0};
// The flow to a key, started from the composed one.
constexpr DenseFlowOptions FlowToKeyOptions(int finest_scale) {
  return {.finest_scale = finest_scale, .patch_stride = 6, .descent_iterations = 5, .refinement_iterations = 0};
}

// The same where motion is small: its error is smaller still, and half resolution is enough.
constexpr DenseFlowOptions NearFlowToKeyOptions(int finest_scale) {
  return {.finest_scale = finest_scale > 1 ? finest_scale : 1,
          .patch_stride = 4,
          .descent_iterations = 12,
          .refinement_iterations = 0};
}

// A track's two ends whose depths differ by more than this share of the nearer are on two surfaces.
inline constexpr float kSameSurface = 0.2F;

// So many frames bear witness to a frame's edges in each direction, the next one with this weight, the second with its
// square: beyond, what they say of an edge is no longer of that edge.
inline constexpr int kWitnessFrames = 2;
inline constexpr float kWitnessWeight = 0.7F;

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_MOTION_OPTIONS_H_
