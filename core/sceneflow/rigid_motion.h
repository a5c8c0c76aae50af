// Rigid motions and their robust fit to pairs of points seen in two frames.
//
// Threads: all functions are pure.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_RIGID_MOTION_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_RIGID_MOTION_H_

#include <array>
#include <span>

#include "core/sceneflow/pixel_rays.h"

namespace depthtween {

struct RigidMotion {
  std::array<float, 9> rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // by rows
  Float3 translation;

  friend bool operator==(const RigidMotion& a, const RigidMotion& b) {
    return a.rotation == b.rotation && a.translation.x == b.translation.x && a.translation.y == b.translation.y &&
           a.translation.z == b.translation.z;
  }
  static RigidMotion Translation(const Float3& by) { return {.translation = by}; }
  Float3 operator*(const Float3& p) const {
    const auto& r = rotation;
    return {r[0] * p.x + r[1] * p.y + r[2] * p.z + translation.x, r[3] * p.x + r[4] * p.y + r[5] * p.z + translation.y,
            r[6] * p.x + r[7] * p.y + r[8] * p.z + translation.z};
  }
};

// A point of the first frame and where it was found in the second.
// How far texture determines the place of a match: a symmetric matrix with eigenvalues in [0,1].
struct FlowInformation {
  float xx = 1.0F, xy = 0.0F, yy = 1.0F;
  float Quadratic(float u, float v) const { return xx * u * u + 2 * xy * u * v + yy * v * v; }
  float Mean() const { return 0.5F * (xx + yy); }
};

struct PointMatch {
  Float3 point;
  Flow2 place;                                    // pixels
  float depth_m = 0.0F;                           // there
  float flow_weight = 1.0F, depth_weight = 1.0F;  // 0 = does not count
  float depth_sigma_m = 0.01F;                    // > 0
  FlowInformation information;
};

struct RigidFitOptions {
  int iterations = 6;
  float flow_sigma_px = 0.5F;
  float outlier_sigmas = 3.0F;  // of the robust kernel (Geman-McClure): what lies farther hardly counts
  // A rotation that the matches do not determine stays near the start's: standard deviation, radians.
  float rotation_sigma = 0.5F;
  float step_sigma_px = 5.0F;  // likewise of a step's translation
};

struct RigidFit {
  RigidMotion motion;
  // Sums of weights, by how far texture determines them: of the matches that agree, and of all.
  float support = 0.0F, possible = 0.0F;
};

// Gauss-Newton with re-weighting from `start`. Residuals: place in pixels and depth in metres, each over its sigma.
RigidFit FitRigidMotion(const PixelRays& rays, std::span<const PointMatch> matches, const RigidMotion& start,
                        const RigidFitOptions& options);

// The support of a motion as it is.
RigidFit Support(const PixelRays& rays, std::span<const PointMatch> matches, const RigidMotion& motion,
                 const RigidFitOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_RIGID_MOTION_H_
