// Scene flow from known optical flow and known depth of both frames, as an upsampled recording has them.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_FLOW_AND_DEPTH_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_FLOW_AND_DEPTH_H_

#include "core/base/image.h"
#include "core/fill/depth_noise.h"
#include "core/sceneflow/pixel_rays.h"
#include "core/sceneflow/scene_flow.h"

namespace depthtween {

// Flow to the next frame and from there back, and depth of both; all W x H, metres, 0 = unknown.
struct FlowAndDepth {
  ImageView<const Flow2> next, back;
  ImageView<const float> from_m, to_m;
};

// The point at the flow's end, on the surface seen there, minus the point now. A pixel is hidden where its flow leaves
// the picture or ends on something nearer, or where the flow back leads elsewhere: its depth changes as that of the
// visible pixels of its layer around it does, or not at all where there are none. Everywhere the change of depth is the
// mean over such pixels that move alike, which takes noise down.
//
// Confidence: 1 visible, 0.2 hidden, 0.05 hidden and alone, 0 where depth is unknown now.
// Threads:    safe to call concurrently; the result does not depend on `threads`.
SceneFlow FromFlowAndDepth(const PixelRays& rays, const FlowAndDepth& frames, const DepthNoise& noise, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_FLOW_AND_DEPTH_H_
