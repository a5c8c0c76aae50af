// Where dense flow says that the points of a frame went.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_FLOW_MATCHES_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_FLOW_MATCHES_H_

#include <array>

#include "core/base/image.h"
#include "core/sceneflow/frame_pair.h"
#include "core/sceneflow/rigid_motion.h"

namespace depthtween {

// A surface that changes its depth by more than this share has been mistaken for another.
inline constexpr float kMostDepthChange = 0.25F;
// Geometry knows depth no better than this share of it: surfaces are sampled at pixels.
inline constexpr float kModelShare = 5e-4F;

struct FlowMatches {
  // Of every pixel. Weights say how far to trust it: whether the flow back returns, whether depth was measured at both
  // ends, whether a silhouette is near, over which flow smears. Information is what texture determines.
  Image<PointMatch> matches;
  Image<uint8_t> smeared;  // nonzero: another surface is near
};

// Flow both ways at the finest scale, forward and backward from `start` where that is not empty; leaves the backward
// flow in start[1]. `labels` as of LabelSurfaces(pair.from.depth_m). Errors: what DenseFlow returns.
absl::StatusOr<FlowMatches> FindFlowMatches(const FramePair& pair, ImageView<const int> labels,
                                            std::array<Image<Flow2>, 2>& start);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_FLOW_MATCHES_H_
