#include "core/sceneflow/sr_flow.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/sceneflow/pyramid.h"
#include "core/sceneflow/rigid_motion.h"

namespace depthtween {
namespace {

constexpr float kLightSigma = 0.02F;    // of [0,1]: a camera's noise and what shading changes
constexpr float kOutlierSigmas = 4.0F;  // of the robust kernel
constexpr int kGlobalIterations = 12;   // of each level
constexpr int kWarps = 6, kSmoothings = 40;
constexpr int kWindowRadius = 2;
constexpr float kCoupling = 4.0F;     // between the twists that data ask for and the smooth ones, 1 / pixel^2
constexpr float kSmoothness = 12.0F;  // of total variation, 1 / pixel

using Vector6 = Eigen::Matrix<float, 6, 1>;
using Matrix6 = Eigen::Matrix<float, 6, 6>;

// Rotation and translation, both in pixels of motion at the frame's median depth, so that one weight suits all six.
struct Twists {
  std::array<Image<float>, 6> part;
  Twists(int width, int height) {
    for (auto& image : part) image = Image<float>(width, height);
  }
  Vector6 At(int x, int y) const {
    Vector6 t;
    for (int i = 0; i < 6; ++i) t[i] = part[i](x, y);
    return t;
  }
  void Set(int x, int y, const Vector6& t) {
    for (int i = 0; i < 6; ++i) part[i](x, y) = t[i];
  }
};

float Influence(float squared) {
  const float root = 1.0F / (1.0F + squared / (kOutlierSigmas * kOutlierSigmas));
  return root * root;
}

// Both residuals of a pixel at a moved point, with derivatives by a twist applied there.
struct Normal {
  Vector6 light, range;                                // derivatives in sigmas, times the root of the influence
  float light_residual = 0.0F, range_residual = 0.0F;  // likewise
  bool known = false;
};

class Level {
 public:
  Level(const PyramidLevel& level, const FramePair& pair)
      : level_(level), pair_(pair), width_(level.rays->width()), height_(level.rays->height()) {
    std::vector<float> depths(level.from.depth_m.data(), level.from.depth_m.data() + level.from.depth_m.pixel_count());
    std::nth_element(depths.begin(), depths.begin() + static_cast<ptrdiff_t>(depths.size() / 2), depths.end());
    median_m_ = depths[depths.size() / 2];
    px_per_m_ = level.rays->focal_px() / median_m_;
  }

  // A twist of one pixel at the median depth: metres of translation, radians of rotation.
  float MetresPerPx() const { return 1.0F / px_per_m_; }
  float RadiansPerPx() const { return 1.0F / (px_per_m_ * median_m_); }

  Float3 Move(const RigidMotion& global, const Vector6& twist, int x, int y) const {
    const Float3 p = global * level_.rays->Point(x, y, level_.from.depth_m(x, y));
    const Eigen::Vector3f turn = RadiansPerPx() * twist.head<3>();
    const float angle = turn.norm();
    Eigen::Vector3f moved(p.x, p.y, p.z);
    if (angle > 0.0F) moved = Eigen::AngleAxisf(angle, turn / angle) * moved;
    moved += MetresPerPx() * twist.tail<3>();
    return {moved.x(), moved.y(), moved.z()};
  }

  Normal At(const Float3& moved, int x, int y) const {
    Normal normal;
    const Flow2 place = level_.to_rays->Project(moved);
    if (!level_.to_rays->Inside(place)) return normal;
    const ImageView<const float> light = level_.to.light, depth = level_.to.depth_m;
    const float there = SampleSurface(depth, place.u, place.v, pair_.noise);
    const auto slope = [&](float dx, float dy) {
      const float after = SampleSurface(depth, place.u + dx, place.v + dy, pair_.noise);
      const float before = SampleSurface(depth, place.u - dx, place.v - dy, pair_.noise);
      return SameLayer(after, before, pair_.noise) ? 0.5F * (after - before) : 0.0F;
    };
    const float light_x =
        0.5F * (SampleBilinear(light, place.u + 1, place.v) - SampleBilinear(light, place.u - 1, place.v));
    const float light_y =
        0.5F * (SampleBilinear(light, place.u, place.v + 1) - SampleBilinear(light, place.u, place.v - 1));
    const float focal = level_.to_rays->focal_px() / moved.z;
    // By the moved point's coordinates; then by the twist: [-[p]x, I].
    const auto by_twist = [&](float gx, float gy, float gz) {
      Vector6 j;
      j << RadiansPerPx() * (moved.y * gz - moved.z * gy), RadiansPerPx() * (moved.z * gx - moved.x * gz),
          RadiansPerPx() * (moved.x * gy - moved.y * gx), MetresPerPx() * gx, MetresPerPx() * gy, MetresPerPx() * gz;
      return j;
    };
    const auto by_point = [&](float su, float sv, float own_z) {
      const float gx = su * focal, gy = sv * focal;
      return by_twist(gx, gy, -(gx * moved.x + gy * moved.y) / moved.z + own_z);
    };
    const float sigma_m = pair_.noise.At(there) + 0.002F * there;
    const float light_residual = (SampleBilinear(light, place.u, place.v) - level_.from.light(x, y)) / kLightSigma;
    const float range_residual = (there - moved.z) / sigma_m;
    const float light_root =
        std::sqrt(Influence(light_residual * light_residual) * Influence(range_residual * range_residual));
    const float range_root = std::sqrt(Influence(range_residual * range_residual));
    normal.light = light_root / kLightSigma * by_point(light_x, light_y, 0.0F);
    normal.range = range_root / sigma_m * by_point(slope(1, 0), slope(0, 1), -1.0F);
    normal.light_residual = light_root * light_residual;
    normal.range_residual = range_root * range_residual;
    normal.known = true;
    return normal;
  }

  // Leaves a point on the axis at the median depth where it is in the picture: flow 0 if both cameras are alike.
  RigidMotion InPlace() const {
    const Camera& from = level_.rays->camera();
    return RigidMotion::Translation(
        level_.to_rays->PointAt(static_cast<float>(from.cx), static_cast<float>(from.cy), median_m_) -
        Float3{0.0F, 0.0F, median_m_});
  }

  // One rigid motion for all pixels, by direct alignment.
  RigidMotion Align(RigidMotion motion) const {
    for (int iteration = 0; iteration < kGlobalIterations; ++iteration) {
      std::vector<Eigen::Matrix<double, 6, 7>> sums(height_, Eigen::Matrix<double, 6, 7>::Zero());
      ParallelFor(height_, pair_.threads, [&](int y) {
        for (int x = 0; x < width_; ++x) {
          const Normal n = At(motion * level_.rays->Point(x, y, level_.from.depth_m(x, y)), x, y);
          if (!n.known) continue;
          const Eigen::Matrix<double, 6, 1> l = n.light.cast<double>(), r = n.range.cast<double>();
          sums[y].leftCols<6>() += l * l.transpose() + r * r.transpose();
          sums[y].col(6) -= n.light_residual * l + n.range_residual * r;
        }
      });
      Eigen::Matrix<double, 6, 7> sum = Eigen::Matrix<double, 6, 7>::Zero();
      for (const auto& row : sums) sum += row;
      Eigen::Matrix<double, 6, 6> a = sum.leftCols<6>();
      a.diagonal().array() += 1e-3;
      const Vector6 step = a.ldlt().solve(sum.col(6)).cast<float>();
      if (!step.allFinite()) break;
      motion = Apply(step, motion);
      if (step.norm() < 1e-3F) break;
    }
    return motion;
  }

  // Twists about `global`, from `twists` on.
  void Refine(const RigidMotion& global, Twists& twists) const {
    const SurfaceTies ties = TiesAlongSurface(*level_.rays, level_.from.depth_m);
    for (int warp = 0; warp < kWarps; ++warp) {
      std::vector<Normal> normals(static_cast<size_t>(width_) * height_);
      ParallelRows(height_, pair_.threads, [&](int first, int last) {
        for (int y = first; y < last; ++y)
          for (int x = 0; x < width_; ++x) normals[y * width_ + x] = At(Move(global, twists.At(x, y), x, y), x, y);
      });
      Twists wanted(width_, height_);
      ParallelRows(height_, pair_.threads, [&](int first, int last) {
        for (int y = first; y < last; ++y)
          for (int x = 0; x < width_; ++x) wanted.Set(x, y, twists.At(x, y) + Step(normals, x, y));
      });
      Smooth(ties, wanted, twists);
    }
  }

 private:
  RigidMotion Apply(const Vector6& step, const RigidMotion& motion) const {
    const Eigen::Vector3f turn = RadiansPerPx() * step.head<3>();
    const float angle = turn.norm();
    const Eigen::Matrix3f by =
        angle > 0 ? Eigen::AngleAxisf(angle, turn / angle).toRotationMatrix() : Eigen::Matrix3f::Identity();
    Eigen::Matrix3f rotation;
    for (int i = 0; i < 9; ++i) rotation(i / 3, i % 3) = motion.rotation[i];
    const Eigen::Matrix3f turned = by * rotation;
    const Eigen::Vector3f moved =
        by * Eigen::Vector3f(motion.translation.x, motion.translation.y, motion.translation.z) +
        MetresPerPx() * step.tail<3>();
    RigidMotion out;
    for (int i = 0; i < 9; ++i) out.rotation[i] = turned(i / 3, i % 3);
    out.translation = {moved.x(), moved.y(), moved.z()};
    return out;
  }

  // What the data in the window on the pixel's surface ask for, damped by the coupling.
  Vector6 Step(const std::vector<Normal>& normals, int x, int y) const {
    Matrix6 a = Matrix6::Zero();
    Vector6 b = Vector6::Zero();
    for (int dy = -kWindowRadius; dy <= kWindowRadius; ++dy)
      for (int dx = -kWindowRadius; dx <= kWindowRadius; ++dx) {
        if (((dx + dy) & 1) != 0 || !level_.from.depth_m.Contains(x + dx, y + dy)) continue;
        const Normal& n = normals[(y + dy) * width_ + x + dx];
        if (!n.known || !SameLayer(level_.from.depth_m(x, y), level_.from.depth_m(x + dx, y + dy), pair_.noise))
          continue;
        a.noalias() += n.light * n.light.transpose() + n.range * n.range.transpose();
        b -= n.light_residual * n.light + n.range_residual * n.range;
      }
    a.diagonal().array() += kCoupling;
    const Vector6 step = a.ldlt().solve(b);
    return step.allFinite() ? step : Vector6::Zero();
  }

  // min over t: kCoupling / 2 |t - wanted|^2 + kSmoothness |T grad t|, each part by itself; by its dual.
  void Smooth(const SurfaceTies& ties, const Twists& wanted, Twists& out) const {
    ParallelFor(6, pair_.threads, [&](int i) {
      Image<float> across(width_, height_), down(width_, height_);
      const Image<float>& f = wanted.part[i];
      Image<float>& t = out.part[i];
      const auto primal = [&] {
        for (int y = 0; y < height_; ++y)
          for (int x = 0; x < width_; ++x) {
            float spread = -ties.right(x, y) * across(x, y) - ties.below(x, y) * down(x, y);
            if (x > 0) spread += ties.right(x - 1, y) * across(x - 1, y);
            if (y > 0) spread += ties.below(x, y - 1) * down(x, y - 1);
            t(x, y) = f(x, y) - spread / kCoupling;
          }
      };
      primal();
      for (int round = 0; round < kSmoothings; ++round) {
        for (int y = 0; y < height_; ++y)
          for (int x = 0; x < width_; ++x) {
            const float gx = ties.right(x, y) * (x + 1 < width_ ? t(x + 1, y) - t(x, y) : 0.0F);
            const float gy = ties.below(x, y) * (y + 1 < height_ ? t(x, y + 1) - t(x, y) : 0.0F);
            const float px = across(x, y) + 0.125F * kCoupling * gx, py = down(x, y) + 0.125F * kCoupling * gy;
            const float shrink = kSmoothness / std::max(kSmoothness, std::sqrt(px * px + py * py));
            across(x, y) = shrink * px;
            down(x, y) = shrink * py;
          }
        primal();
      }
    });
  }

  const PyramidLevel& level_;
  const FramePair& pair_;
  const int width_, height_;
  float median_m_ = 1.0F, px_per_m_ = 1.0F;
};

}  // namespace

absl::StatusOr<SceneFlow> SemiRigidFlow(const FramePair& pair) {
  const std::vector<PyramidLevel> levels = BuildPyramid(pair);
  RigidMotion global = Level(levels.back(), pair).InPlace();
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) global = Level(*level, pair).Align(global);
  RETURN_IF_ERROR(pair.StepDone());
  Twists twists(levels.back().rays->width(), levels.back().rays->height());
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    RETURN_IF_ERROR(pair.StepDone());
    const int width = level->rays->width(), height = level->rays->height();
    // A pixel of the finer level is half as wide.
    if (level != levels.rbegin())
      for (auto& part : twists.part) part = Enlarge(part, width, height, 2.0F);
    Level(*level, pair).Refine(global, twists);
  }
  const Level finest(levels.front(), pair);
  SceneFlow out = EmptySceneFlow(pair.rays.width(), pair.rays.height());
  for (int y = 0; y < pair.rays.height(); ++y)
    for (int x = 0; x < pair.rays.width(); ++x) {
      Float3 moved = finest.Move(global, twists.At(x, y), x, y);
      moved.z = std::max(moved.z, kNearestMovedShare * pair.from.depth_m(x, y));
      SetMotion(pair, x, y, moved, out);
      out.confidence(x, y) = 1.0F;
    }
  return out;
}

}  // namespace depthtween
