#include "core/synthetic/scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace depthtween {
namespace {

// Balls that together hold an axis-aligned box, few and tight: the box is cut across its longest side.
std::vector<Ball> Cover(const Eigen::AlignedBox3d& box, const Affine& world_from_box) {
  constexpr int kMaxBalls = 16;
  const Vec3 size = box.sizes();
  int longest = 0;
  const double length = size.maxCoeff(&longest);
  const double width = std::max(size[(longest + 1) % 3], size[(longest + 2) % 3]);
  const int count = std::clamp(static_cast<int>(std::ceil(length / std::max(width, 1e-6))), 1, kMaxBalls);
  Vec3 piece = size;
  piece[longest] /= count;
  // The largest stretch of an affine map is its linear part's largest singular value; the Frobenius norm bounds it.
  const Eigen::Matrix3d& linear = world_from_box.linear();
  const bool rigid = (linear.transpose() * linear).isIdentity(1e-9);
  const double radius = 0.5 * piece.norm() * (rigid ? 1.0 : linear.norm()) + 1e-9;
  std::vector<Ball> balls;
  for (int i = 0; i < count; ++i) {
    Vec3 center = box.min() + 0.5 * piece;
    center[longest] += i * piece[longest];
    balls.push_back({world_from_box * center, radius});
  }
  return balls;
}

}  // namespace

Hit Snapshot::Cast(const Ray& ray, double s_max, const std::vector<int>& candidates) const {
  Hit hit{.s = s_max};
  for (const int i : candidates) {
    const PlacedPart& part = parts_[i];
    const Ray local{part.part_from_world * ray.origin, part.part_from_world.linear() * ray.direction};
    ShapeHit found;
    if (part.shape->Intersect(local, hit.s, &found)) hit = {i, found.s, found.material, found.normal};
  }
  return hit;
}

Vec3 Snapshot::WorldNormal(const Hit& hit, const Vec3& towards) const {
  const Vec3 normal = (parts_[hit.part].part_from_world.linear().transpose() * hit.normal).normalized();
  return normal.dot(towards) < 0 ? Vec3(-normal) : normal;
}

int Scene::AddBody(std::string name, Motion motion) {
  const bool moves = motion != nullptr;
  bodies_.push_back({std::move(name), moves, moves ? std::move(motion) : [](double) { return Affine::Identity(); }});
  return static_cast<int>(bodies_.size()) - 1;
}

void Scene::AddPart(int body, std::shared_ptr<const Shape> shape, const Affine& body_from_part, const Paint& paint,
                    bool casts_shadow) {
  parts_.push_back({.body = body,
                    .body_from_part = body_from_part,
                    .paint = paint,
                    .shape = std::move(shape),
                    .casts_shadow = casts_shadow});
}

void Scene::AddSheet(int body, DeformingShape deforming, const Paint& paint) {
  bodies_[body].moves = true;
  parts_.push_back({.body = body, .paint = paint, .deforming = std::move(deforming)});
}

Snapshot Scene::At(double time_s) const {
  std::vector<Affine> world_from_body;
  world_from_body.reserve(bodies_.size());
  for (const Body& body : bodies_) world_from_body.push_back(body.motion(time_s));
  std::vector<Snapshot::PlacedPart> placed;
  placed.reserve(parts_.size());
  for (const Part& part : parts_) {
    const Affine world_from_part = world_from_body[part.body] * part.body_from_part;
    std::shared_ptr<const Shape> shape = part.deforming ? part.deforming(time_s) : part.shape;
    placed.push_back({.world_from_part = world_from_part,
                      .part_from_world = world_from_part.inverse(),
                      .balls = Cover(shape->Bounds(), world_from_part),
                      .body = part.body,
                      .paint = &part.paint,
                      .casts_shadow = part.casts_shadow});
    placed.back().shape = std::move(shape);
  }
  return Snapshot(std::move(placed));
}

}  // namespace depthtween
