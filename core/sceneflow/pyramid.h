// A pair of frames at half, quarter, ... size: what coarse-to-fine methods work on.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_PYRAMID_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_PYRAMID_H_

#include <array>
#include <memory>
#include <vector>

#include "core/base/image.h"
#include "core/sceneflow/frame_pair.h"

namespace depthtween {

struct PyramidFrame {
  Image<float> light;    // luma in [0,1]
  Image<float> depth_m;  // > 0; of one surface, never a mixture
};

struct PyramidLevel {
  std::unique_ptr<const PixelRays> rays, to_rays;
  PyramidFrame from, to;
};

// Finest first, each half the size of the one before (rounded up), until the shorter side is under 2 * `least_side`.
// Light is averaged after a binomial blur; of depth, in each 2 x 2 the mean of those that share the layer of the
// nearest.
std::vector<PyramidLevel> BuildPyramid(const FramePair& pair, int least_side = 16);

// A field of the next coarser level on the finer grid: bilinear, values times `scale`.
Image<float> Enlarge(ImageView<const float> coarse, int width, int height, float scale);

// The middle of the 3 x 3 around each pixel; edges repeat.
Image<float> Median3(ImageView<const float> image, int threads);

// How strongly a pixel is tied to its right and lower neighbour along the surface: the distance of two points one pixel
// apart on a wall that faces the camera, over their real distance. 1 on such a wall, near 0 across a jump.
// Source: Jaimez et al. 2015, eq. 7.
struct SurfaceTies {
  Image<float> right, below;  // in [0,1]; 0 in the last column and row
};
SurfaceTies TiesAlongSurface(const PixelRays& rays, ImageView<const float> depth_m);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_PYRAMID_H_
