// What a camera with a thin lens sees of a scene: the mean over many pinholes spread across its aperture. The reference
// for every rendered depth of field, since each pinhole sees past silhouettes what it really would.
//
// Threads: pure; the result does not depend on `threads`.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_LENS_RENDER_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_LENS_RENDER_H_

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/synthetic/scene.h"

namespace depthtween {

// A disc of `aperture_m` across, centred on the camera's pinhole. Points at depth `focus_m` are seen sharp, and at the
// pixel where the pinhole sees them; points at depth z spread over a disc of fx * aperture_m / 2 * |1 / focus_m - 1 /
// z| pixels' radius.
struct ThinLens {
  double aperture_m = 0.0;
  double focus_m = 1.0;
};

// 8-bit sRGB of light averaged over `samples` rays a pixel (>= 1), each through its own place of the aperture and of
// the pixel, clipped to white one by one: the same light that Renderer::Color records. `camera` must have no
// distortion.
Image<Rgb8> RenderThroughLens(const Scene& scene, const Camera& camera, const Pose& world_from_camera, double time_s,
                              const ThinLens& lens, int samples, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_LENS_RENDER_H_
