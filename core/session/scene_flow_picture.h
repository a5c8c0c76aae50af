// Pictures of motion for people.
#ifndef DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_PICTURE_H_
#define DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_PICTURE_H_

#include <span>
#include <vector>

#include "core/base/float3.h"
#include "core/base/image.h"
#include "core/metrics/scene_flow_errors.h"

namespace depthtween {

// Motion across the picture as hue (right is red, down is green-yellow, left is cyan, up is violet) and saturation:
// standing still is white, `full_px` and more full colour. Pixels without an answer are dark grey.
Image<Rgb8> ColorizeFlow(const MotionField& motion, float full_px);
// Motion towards the camera is red, away from it blue, none white; full colour at `full_m` metres.
Image<Rgb8> ColorizeDepthChange(const MotionField& motion, float full_m);
// |S^ - S|: none is black, `full_m` and more bright (Inferno's ends); dark grey where either is unknown.
Image<Rgb8> ColorizeMotionError(const MotionField& estimate, const MotionField& truth, float full_m);

// What nearly all motions stay below: their 95th percentile, at least 0.5 px and 5 mm.
struct MotionRange {
  float full_px = 0.5F, full_m = 0.005F;
};
MotionRange RangeOf(const MotionField& motion);

// Pictures of one size side by side in rows with a gap; all rows as long as the first.
Image<Rgb8> Tile(std::span<const std::vector<Image<Rgb8>>> rows);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_PICTURE_H_
