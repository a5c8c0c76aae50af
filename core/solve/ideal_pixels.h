// Pixels as the camera shows them and as one without distortion would: the solver thinks in the latter.
#ifndef DEPTHTWEEN_CORE_SOLVE_IDEAL_PIXELS_H_
#define DEPTHTWEEN_CORE_SOLVE_IDEAL_PIXELS_H_

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/solve/triple.h"

namespace depthtween {

// Threads: safe to call concurrently. Pixels outside the image are taken to shift as its border does.
class IdealPixels {
 public:
  explicit IdealPixels(const Camera& camera);
  const Pinhole<float>& pinhole() const { return pinhole_; }
  PixelOf<float> Ideal(float x, float y) const;
  PixelOf<float> Seen(float u, float v) const;
  // The point at depth z (metres) seen at a pixel of the camera.
  Triple<float> PointAt(float x, float y, float z) const;

 private:
  Camera camera_;
  Pinhole<float> pinhole_;
  Image<float> shift_u_, shift_v_;  // seen -> ideal; empty without distortion
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_IDEAL_PIXELS_H_
