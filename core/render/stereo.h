// A second eye for a recorded view: depth-image-based rendering of a stereo pair.
//
// Sign:     disparity d(z) = x_left - x_right = f_px B (1/z - 1/z_c) in pixels, x to the right: positive in front of
// the
//           screen (crossed), 0 at the convergence depth z_c, negative behind it. The virtual cameras are parallel;
//           their images are shifted to meet at z_c.
// Lenses:   rows stay rows: shifts are horizontal in the recorded image, so that no vertical disparity arises; lens
//           distortion stays in both eyes alike.
// Source:   Fehn, Depth-image-based rendering, compression and transmission for 3D-TV, SPIE 2004; de Albuquerque
// Azevedo
//           et al., the paper's reference; ours warps two layers instead of one, so that holes are closed in the view's
//           own frame, once for every eye.
// Threads:  safe to call concurrently; `threads` only splits rows, results do not depend on it.
#ifndef DEPTHTWEEN_CORE_RENDER_STEREO_H_
#define DEPTHTWEEN_CORE_RENDER_STEREO_H_

#include <optional>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/geometry/camera.h"
#include "core/render/hidden_background.h"
#include "core/render/render_view.h"

namespace depthtween {

// Depth of a whole clip: 1st and 99th percentile and median, metres, 0 < near <= median <= far.
struct DepthDistribution {
  double near_m = 0.0, far_m = 0.0, median_m = 0.0;
};

// The other eye is the recorded colour, bit for bit but for the floating window. kBoth: each half way.
enum class MadeEye { kLeft, kRight, kBoth };

struct StereoOptions {
  MadeEye made = MadeEye::kLeft;
  std::optional<double> baseline_m;     // 0 to 100; none: from `divergence_percent`
  double divergence_percent = 2.0;      // disparity between near_m and far_m, percent of the image width, (0, 20]
  std::optional<double> convergence_m;  // > 0, may be infinite; none: the median depth, or farther in front of the near
                                        // third of the disparity range if that leaves more in front of the screen
  bool floating_window = true;          // black borders that bring the window before what the frame cuts

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// The numbers that hold for every frame of a clip.
struct StereoGeometry {
  double focal_px = 0.0, baseline_m = 0.0, convergence_m = 0.0;
  int window_px = 0;                   // black columns at the left of the left eye and at the right of the right eye
  HiddenBackgroundOptions background;  // what RenderStereo wants to be found

  double DisparityPx(double z_m) const { return focal_px * baseline_m * (1 / z_m - 1 / convergence_m); }
};

// InvalidArgument: options or distribution do not validate, or the disparities would exceed a fifth of the width.
absl::StatusOr<StereoGeometry> ResolveStereo(const Camera& camera, const StereoOptions& options,
                                             const DepthDistribution& depth);

struct StereoPair {
  Image<Rgb8> left, right;
};

// Pixels of unknown depth go with the farther of their known neighbours in the row. What neither layer shows (past the
// image's border, or deeper under a foreground than `hidden` reaches) continues the background beside it.
// `hidden` is FindHiddenBackground(view, ..., geometry.background, ...).
StereoPair RenderStereo(const RenderView& view, const HiddenBackground& hidden, const StereoGeometry& geometry,
                        const StereoOptions& options, int threads);

// One eye alone, at `offset` baselines to the right of the view (-1: the left eye of a recorded right one), without
// floating window. `missing`, if given, becomes W x H: 1 where the view itself shows nothing.
Image<Rgb8> RenderEye(const RenderView& view, const HiddenBackground& hidden, const StereoGeometry& geometry,
                      double offset, int threads, Image<uint8_t>* missing = nullptr);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_STEREO_H_
