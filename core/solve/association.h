// The partner of a trajectory's end on the other key's surface.
//
// It is looked for where the trajectory is predicted to be seen, not nearest in space: the closest point ties fast
// motion to zero. A partner lies in the predicted layer, faces alike and looks alike. Source: Yuan et al. 2018, section
// 3.1, eq. 2-3; we differ in where we look.
#ifndef DEPTHTWEEN_CORE_SOLVE_ASSOCIATION_H_
#define DEPTHTWEEN_CORE_SOLVE_ASSOCIATION_H_

#include <optional>

#include "core/fill/depth_noise.h"
#include "core/solve/ideal_pixels.h"
#include "core/solve/surface.h"

namespace depthtween {

// The other key.
struct PartnerSurface {
  ImageView<const float> depth_m;
  ImageView<const Rgb8> color;
  const IdealPixels* pixels = nullptr;
  DepthNoise noise;
  int reach = 2;  // of normals, pixels
};

struct Partner {
  Triple<float> point, normal;  // normal (0, 0, 0): not known
};

// Looks at the pixel where `predicted` (metres, in the other key's camera) is seen and then around it. `normal` is the
// point's own, turned as predicted; (0, 0, 0) passes. Nothing if no pixel passes all gates.
std::optional<Partner> FindPartner(const PartnerSurface& surface, const Triple<float>& predicted,
                                   const Triple<float>& normal, Rgb8 color);

// The paper's published form: the point of the other key closest to `point` (where the trajectory starts), searched
// for within five pixels of its projection.
std::optional<Partner> ClosestPartner(const PartnerSurface& surface, const Triple<float>& point);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_ASSOCIATION_H_
