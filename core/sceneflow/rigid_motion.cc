#include "core/sceneflow/rigid_motion.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace depthtween {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

// Influence of a squared residual (in sigmas) under Geman and McClure's kernel: 1 at 0, 1/4 at the scale.
float Influence(float squared, float scale) {
  const float root = 1.0F / (1.0F + squared / (scale * scale));
  return root * root;
}

struct Residual {
  Float3 moved;
  float u, v, z;  // in sigmas
  float flow_influence, depth_influence;
};

Residual At(const PixelRays& rays, const PointMatch& match, const RigidMotion& motion, const RigidFitOptions& options) {
  Residual r;
  r.moved = motion * match.point;
  const Flow2 place = rays.Project(r.moved);
  r.u = (place.u - match.place.u) / options.flow_sigma_px;
  r.v = (place.v - match.place.v) / options.flow_sigma_px;
  r.z = (r.moved.z - match.depth_m) / match.depth_sigma_m;
  r.flow_influence = match.flow_weight * Influence(match.information.Quadratic(r.u, r.v), options.outlier_sigmas);
  r.depth_influence = match.depth_weight * Influence(r.z * r.z, options.outlier_sigmas);
  return r;
}

RigidMotion Compose(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
  const Eigen::Matrix3d m = rotation.toRotationMatrix();
  RigidMotion motion;
  for (int i = 0; i < 9; ++i) motion.rotation[i] = static_cast<float>(m(i / 3, i % 3));
  motion.translation = {static_cast<float>(translation.x()), static_cast<float>(translation.y()),
                        static_cast<float>(translation.z())};
  return motion;
}

}  // namespace

RigidFit Support(const PixelRays& rays, std::span<const PointMatch> matches, const RigidMotion& motion,
                 const RigidFitOptions& options) {
  RigidFit fit{.motion = motion};
  for (const PointMatch& match : matches) {
    const float textured = match.information.Mean();
    fit.possible += textured * match.flow_weight;
    if (!(match.flow_weight > 0.0F)) continue;
    const Residual r = At(rays, match, motion, options);
    fit.support += textured * r.flow_influence * Influence(r.z * r.z, options.outlier_sigmas);
  }
  return fit;
}

RigidFit FitRigidMotion(const PixelRays& rays, std::span<const PointMatch> matches, const RigidMotion& start,
                        const RigidFitOptions& options) {
  Eigen::Matrix3d start_rotation;
  for (int i = 0; i < 9; ++i) start_rotation(i / 3, i % 3) = start.rotation[i];
  Eigen::Quaterniond rotation(start_rotation);
  rotation.normalize();
  Eigen::Vector3d translation(start.translation.x, start.translation.y, start.translation.z);
  RigidMotion motion = start;
  const float focal = rays.focal_px();
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    // Rotating about the matches' middle keeps rotation and translation apart.
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    double total = 0.0;
    for (const PointMatch& match : matches) {
      if (!(match.flow_weight > 0.0F)) continue;
      const Float3 p = motion * match.point;
      middle += match.flow_weight * Eigen::Vector3d(p.x, p.y, p.z);
      total += match.flow_weight;
    }
    if (!(total > 0.0)) break;
    middle /= total;
    Matrix6 a = Matrix6::Zero();
    Vector6 b = Vector6::Zero();
    for (const PointMatch& match : matches) {
      if (!(match.flow_weight > 0.0F) && !(match.depth_weight > 0.0F)) continue;
      const Residual r = At(rays, match, motion, options);
      if (!(r.moved.z > 0.0F)) continue;
      const double x = r.moved.x - middle.x(), y = r.moved.y - middle.y(), z = r.moved.z - middle.z();
      // d moved / d (rotation, translation) = [-[p]x, I]; then the projection's and depth's own derivatives.
      const double scale = focal / r.moved.z / options.flow_sigma_px;
      const double px = r.moved.x / r.moved.z, py = r.moved.y / r.moved.z;
      Vector6 ju, jv, jz;
      jz << y, -x, 0.0, 0.0, 0.0, 1.0;
      ju << 0.0, z, -y, 1.0, 0.0, 0.0;
      jv << -z, 0.0, x, 0.0, 1.0, 0.0;
      ju = scale * (ju - px * jz);
      jv = scale * (jv - py * jz);
      jz /= match.depth_sigma_m;
      const FlowInformation& w = match.information;
      const Vector6 wu = w.xx * ju + w.xy * jv, wv = w.xy * ju + w.yy * jv;
      a.noalias() += r.flow_influence * (wu * ju.transpose() + wv * jv.transpose());
      a.noalias() += r.depth_influence * (jz * jz.transpose());
      b -= r.flow_influence * (r.u * wu + r.v * wv) + r.depth_influence * (r.z * jz);
    }
    for (int i = 0; i < 3; ++i) a(i, i) += 1.0 / (options.rotation_sigma * options.rotation_sigma);
    const double px_per_m = focal / std::max(middle.z(), 1e-3);
    for (int i = 3; i < 6; ++i) a(i, i) += px_per_m * px_per_m / (options.step_sigma_px * options.step_sigma_px);
    const Vector6 step = a.ldlt().solve(b);
    if (!step.allFinite()) break;
    Eigen::Vector3d turn = step.head<3>();
    const double angle = turn.norm();
    if (angle > 0.3) turn *= 0.3 / angle;  // where the linear model still holds
    const Eigen::Quaterniond by(
        Eigen::AngleAxisd(turn.norm(), angle > 0 ? turn.normalized() : Eigen::Vector3d::UnitX()));
    rotation = (by * rotation).normalized();
    translation = by * (translation - middle) + middle + step.tail<3>();
    motion = Compose(rotation, translation);
    if (angle < 1e-6 && step.tail<3>().norm() < 1e-6) break;
  }
  return Support(rays, matches, motion, options);
}

}  // namespace depthtween
