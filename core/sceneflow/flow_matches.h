// Where dense flow, and range flow, say that the points of a frame went.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_FLOW_MATCHES_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_FLOW_MATCHES_H_

#include <array>

#include "core/base/image.h"
#include "core/sceneflow/frame_pair.h"
#include "core/sceneflow/rigid_motion.h"

namespace depthtween {

// A match whose depth changes by more than this share has landed on another surface.
inline constexpr float kMostDepthChange = 0.25F;
// Geometry knows depth no better than this share of it: surfaces are sampled at pixels.
inline constexpr float kModelShare = 5e-4F;

struct FlowMatches {
  // Of every pixel. Weights say how far to trust it: whether the flow back returns, whether depth was measured at both
  // ends, whether a silhouette is near, over which flow smears. Information is what texture determines.
  Image<PointMatch> matches;
  Image<uint8_t> smeared;  // nonzero: another surface is near
  // The same for motion that flow had lost and that was recovered (core/flow/lost_motion.h); weight 0 elsewhere. Empty
  // if none was. A repeating pattern gives false matches: these only propose candidates, and have no vote.
  Image<PointMatch> found_again;
};

// Flow both ways at the finest scale, forward and backward from `start` where that is not empty; leaves the backward
// flow in start[1]. `labels` as of LabelSurfaces(pair.from.depth_m). Errors: what DenseFlow returns.
absl::StatusOr<FlowMatches> FindFlowMatches(const FramePair& pair, ImageView<const int> labels,
                                            std::array<Image<Flow2>, 2>& start);

// A second opinion of every pixel: range flow, coarse to fine down to half resolution. Smooth along surfaces and led by
// their depth, it follows limbs and cloth on which dense flow breaks; it drags along what a surface hides, and sees no
// small thing that goes far. Cancelled when `pair.stop` fires.
absl::StatusOr<Image<PointMatch>> FindRangeMatches(const FramePair& pair);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_FLOW_MATCHES_H_
