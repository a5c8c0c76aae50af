// Prepares a measured depth map for use as a source: mixed pixels out, holes filled along colour, noise down.
//
// Shapes:   all images W x H.  Units: metres along z, 0 = unknown; distances in pixels.
// Threads:  safe to call concurrently; `threads` only splits rows, results do not depend on it.
#ifndef DEPTHTWEEN_CORE_FILL_KEY_CLEANING_H_
#define DEPTHTWEEN_CORE_FILL_KEY_CLEANING_H_

#include <vector>

#include "core/base/image.h"
#include "core/fill/depth_noise.h"

namespace depthtween {

// Sets to 0 the pixels that lie between two layers with too few neighbours on either: mixtures of foreground and
// background as time-of-flight and structured-light sensors return them at silhouettes ("flying pixels").
Image<float> RemoveFlyingPixels(ImageView<const float> depth_m, const DepthNoise& noise, int threads);

// A depth frame taken at another time, with the colour it is seen in.
struct DepthWitness {
  ImageView<const float> depth_m;
  ImageView<const Rgb8> color;
};
// Where the colours around a pixel stand still between `color` and a witness's, its measurement counts as well: noise
// is averaged, a drop-out that two witnesses fill alike is filled, and a mixture or a flicker gives way to the layer
// that most of the measurements lie in. Elsewhere `depth_m` stays. At most kMaxWitnesses.
constexpr int kMaxWitnesses = 8;
Image<float> SettleWhereStill(ImageView<const float> depth_m, ImageView<const Rgb8> color,
                              const std::vector<DepthWitness>& witnesses, const DepthNoise& noise, int threads);

// Whether the camera stood still between two frames, by what has texture in the first: most of it stays in place,
// however much moves before it. Where nothing has texture, nothing shows that it did.
bool CameraStoodStill(ImageView<const Rgb8> color, ImageView<const Rgb8> other);

struct FilledDepth {
  Image<float> depth_m;   // 0 only if nothing was measured at all
  Image<float> distance;  // geodesic pixels to the measurement it was taken from; 0 = measured
};
// Gives every unknown pixel the depth of the measured pixel that is nearest along colour: the length of a path is one
// per pixel plus the colour differences it crosses (sRGB units over `kColorPerPixel`). Source: geodesic distance by
// raster sweeps, Toivanen, New geodesic distance transforms for gray-scale images, 1996.
FilledDepth FillAlongColor(ImageView<const float> depth_m, ImageView<const Rgb8> color);

// Replaces each depth by a plane fitted robustly, in inverse depth, to the pixels of its layer and colour around it.
// A plane in space is affine in (x, y, 1/z), so slants keep their depth. Pixels without support stay as they are.
// `radius` of the window: 1 .. kMaxDenoiseRadius pixels.
constexpr int kMaxDenoiseRadius = 7;
Image<float> DenoiseInLayers(ImageView<const float> depth_m, ImageView<const float> distance,
                             ImageView<const Rgb8> color, const DepthNoise& noise, int radius, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FILL_KEY_CLEANING_H_
