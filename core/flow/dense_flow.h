// Dense optical flow between colour frames, and arithmetic on flow fields.
//
// Flow a->b at pixel x of frame a: x + flow(x) is where that surface point is seen in frame b. Pixels; see
// base/image.h. Source: DIS (Kroeger et al., Fast Optical Flow using Dense Inverse Search, ECCV 2016), as OpenCV builds
// it, on one thread (one_opencv_thread.h): callers run pairs side by side instead, which scales and repeats bit for
// bit.
#ifndef DEPTHTWEEN_CORE_FLOW_DENSE_FLOW_H_
#define DEPTHTWEEN_CORE_FLOW_DENSE_FLOW_H_

#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"

namespace depthtween {

struct DenseFlowOptions {
  // 0 matches at full resolution, 1 at half, ...: cost falls by about 3 a step.
  int finest_scale = 1;
  // Distance between patches, pixels at the finest scale (patch size is 8).
  int patch_stride = 3;
  int descent_iterations = 25;
  int refinement_iterations = 5;  // variational refinement, per scale

  absl::Status Validate() const;
};

// BT.601 luma, 8 bit: what the flow is computed on.
Image<uint8_t> Luma(ImageView<const Rgb8> color);

// Flow from `from` to `to`. `start`, when given, competes with the coarse-to-fine estimate patch by patch, so that
// motions beyond the pyramid's reach are kept when they fit. Images of one size, at least 16 x 16; smaller ones give
// zero flow (or `start`). Threads: safe to call concurrently. Errors: Internal if OpenCV fails.
absl::StatusOr<Image<Flow2>> DenseFlow(ImageView<const uint8_t> from, ImageView<const uint8_t> to,
                                       const DenseFlowOptions& options, const Image<Flow2>* start = nullptr);

// Bilinear value at a sub-pixel position, clamped to the image.
Flow2 SampleFlow(ImageView<const Flow2> flow, float x, float y);

// a->c from a->b and b->c: ac(x) = ab(x) + bc(x + ab(x)). `ab` may be known at every `step`-th pixel only: entry (i, j)
// is pixel (i * step, j * step); so is the result.
Image<Flow2> Compose(ImageView<const Flow2> ab, ImageView<const Flow2> bc, int step = 1);

// Displacement of pixel (x, y) of frame a along `steps` a->b, b->c, ...: what Compose gives there. Not empty.
Flow2 FollowFlows(const std::vector<ImageView<const Flow2>>& steps, int x, int y);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FLOW_DENSE_FLOW_H_
