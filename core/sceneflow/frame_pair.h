// The input of all methods: both frames, with depth denoised and its holes filled.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_FRAME_PAIR_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_FRAME_PAIR_H_

#include <array>
#include <functional>
#include <stop_token>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/fill/depth_noise.h"
#include "core/sceneflow/pixel_rays.h"
#include "core/sceneflow/scene_flow.h"

namespace depthtween {

struct PreparedFrame {
  ImageView<const Rgb8> color;
  ImageView<const float> measured_m;  // as it came, 0 = unknown
  Image<uint8_t> luma;
  Image<float> depth_m;   // mixed pixels out, holes filled along colour, noise down within layers; > 0 everywhere
  Image<float> distance;  // pixels along colour to the measurement; 0 = measured
};

struct FramePair {
  PixelRays rays, to_rays;  // of the first and of the second frame's camera
  DepthNoise noise;
  PreparedFrame from, to;
  int threads = 1;
  std::stop_token stop = {};
  std::function<void()> on_item = nullptr;  // may be empty

  // For between two steps of a method, on its thread: tells that one is done. Cancelled once `stop` fires.
  absl::Status StepDone() const {
    if (on_item) on_item();
    return stop.stop_requested() ? absl::CancelledError("stopped on request") : absl::OkStatus();
  }
};

// No point comes nearer in one step than this share of its depth: keeps wild estimates in front of the camera.
inline constexpr float kNearestMovedShare = 0.05F;

// The answer of a pixel whose point moves to `moved` (in the camera's frame of the second time).
inline void SetMotion(const FramePair& pair, int x, int y, const Float3& moved, SceneFlow& out) {
  const float z = pair.from.depth_m(x, y);
  const Flow2 place = pair.to_rays.Project(moved);
  out.flow_px(x, y) = {place.u - static_cast<float>(x), place.v - static_cast<float>(y)};
  out.motion_m(x, y) = moved - pair.rays.Point(x, y, z);
  out.depth_m(x, y) = z;
}

inline SceneFlow EmptySceneFlow(int width, int height) {
  return {Image<Flow2>(width, height), Image<Float3>(width, height), Image<float>(width, height),
          Image<float>(width, height), Image<uint8_t>(width, height)};
}

// Depth at a place between pixels, on the surface of the nearest pixel only: bilinear, in inverse depth, over those of
// the four pixels that share its layer. Places outside take the nearest pixel.
float SampleSurface(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_FRAME_PAIR_H_
