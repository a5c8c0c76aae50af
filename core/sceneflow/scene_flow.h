// Scene flow: where every pixel of one RGB-D frame goes until the next, in metres.
//
// `ours` is the method of this project (rigid_windows.h). The others re-implement the ideas of published methods, for
// comparison; they are not their authors' code and not tuned like it (pd_flow.h, sr_flow.h, layered_flow.h).
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_SCENE_FLOW_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_SCENE_FLOW_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/float3.h"
#include "core/base/image.h"
#include "core/base/status.h"
#include "core/fill/depth_noise.h"
#include "core/geometry/camera.h"
#include "core/options/scene_flow_options.h"
#include "core/sequence/rgbd_view.h"

namespace depthtween {

// All images have the size of the first frame. A pixel has an answer where `confidence` is above 0; elsewhere all is 0.
struct SceneFlow {
  Image<Flow2> flow_px;     // to the second frame
  Image<Float3> motion_m;   // the point in the camera's frame at the second time minus the point at the first
  Image<float> depth_m;     // of the first frame, as the motion starts from: cleaned of noise, holes filled
  Image<float> confidence;  // (0,1]: 1 = seen in both frames and explained; low where hidden, filled or unexplained
  Image<uint8_t> hidden;    // nonzero: believed hidden or outside in the second frame
};

struct SceneFlowOptions {
  std::string method = "ours";           // one of SceneFlowMethods()
  std::optional<DepthNoise> noise = {};  // of the depth; none: estimated from both frames
  // The second frame's camera, where it is another than the first's: another zoom or another crop, of the same size.
  std::optional<Camera> to_camera = {};
  int threads = 1;  // does not change the result. >= 1
  std::stop_token stop = {};
  // Called between the steps of the method, from the calling thread. May be empty.
  std::function<void()> on_item = nullptr;

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// Shapes:   colour and depth W x H as the camera says.
// Errors:   InvalidArgument for options, a camera that does not validate and sizes that differ; FailedPrecondition when
//           a depth map holds not one measurement; Cancelled when `stop` fires.
// Threads:  safe to call concurrently.
absl::StatusOr<SceneFlow> EstimateSceneFlow(const Camera& camera, const RgbdView& from, const RgbdView& to,
                                            const SceneFlowOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_SCENE_FLOW_H_
