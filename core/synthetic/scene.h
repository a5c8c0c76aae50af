// Worlds that move: bodies of shapes, each under a motion that is known at any time, and a camera path.
//
// One mechanism gives all truth: a ray meets a surface at a material coordinate, the material coordinate has a place at
// every other time, and that place is seen at a pixel, or hidden.
// World: x right, y forward, z up, metres; time in seconds. Scenes are defined for all times and move most from 0 on.
// Threads: a Scene is immutable once made, a Snapshot always; both are safe to read concurrently.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_SCENE_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_SCENE_H_

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>

#include "core/base/status.h"
#include "core/synthetic/paint.h"
#include "core/synthetic/shapes.h"

namespace depthtween {

using Affine = Eigen::Affine3d;
using Pose = Eigen::Isometry3d;

// Where a body is: world_from_body at a time. Affine, so that a ball can squash.
using Motion = std::function<Affine(double time_s)>;
using CameraPath = std::function<Pose(double time_s)>;
using DeformingShape = std::function<std::shared_ptr<const Shape>(double time_s)>;

// What truth calls an object: parts that share a motion.
struct Body {
  std::string name;
  bool moves = false;
  Motion motion;
};

struct Part {
  int body = 0;
  Affine body_from_part = Affine::Identity();
  Paint paint;
  std::shared_ptr<const Shape> shape;  // or, for a part that deforms:
  DeformingShape deforming;
  bool casts_shadow = true;
};

struct Hit {
  int part = -1;  // -1: the ray met nothing
  double s = std::numeric_limits<double>::infinity();
  Vec3 material = Vec3::Zero();
  Vec3 normal = Vec3::Zero();  // of the part's frame
};

struct Ball {
  Vec3 center;
  double radius;
};

// A scene at one instant. Must not outlive its scene.
class Snapshot {
 public:
  struct PlacedPart {
    Affine world_from_part, part_from_world;
    std::shared_ptr<const Shape> shape;
    std::vector<Ball> balls;  // together around the part: one, or a row along a long part
    int body;
    const Paint* paint;
    bool casts_shadow;
  };

  explicit Snapshot(std::vector<PlacedPart> parts) : parts_(std::move(parts)) {}
  const std::vector<PlacedPart>& parts() const { return parts_; }

  // The first surface along a world ray with s < s_max, among the parts `candidates`.
  Hit Cast(const Ray& ray, double s_max, const std::vector<int>& candidates) const;
  // The place of a material point now.
  Vec3 Locate(int part, const Vec3& material) const {
    return parts_[part].world_from_part * parts_[part].shape->Locate(material);
  }
  // The unit normal of a hit in the world, on the side that faces `towards`.
  Vec3 WorldNormal(const Hit& hit, const Vec3& towards) const;

 private:
  std::vector<PlacedPart> parts_;
};

class Scene {
 public:
  explicit Scene(std::string name) : name_(std::move(name)) {}

  // Building. A body's index is its place in bodies(); a null motion stays at the identity.
  int AddBody(std::string name, Motion motion = nullptr);
  void AddPart(int body, std::shared_ptr<const Shape> shape, const Affine& body_from_part, const Paint& paint,
               bool casts_shadow = true);
  void AddSheet(int body, DeformingShape deforming, const Paint& paint);
  void SetCamera(CameraPath path) { camera_path_ = std::move(path); }
  void AddLamp(const Vec3& position, float strength) { lamps_.push_back({position, strength}); }

  struct Lamp {
    Vec3 position;
    float strength;  // irradiance on a surface that faces it, at any distance
  };
  const std::string& name() const { return name_; }
  const std::vector<Body>& bodies() const { return bodies_; }
  const std::vector<Part>& parts() const { return parts_; }
  const std::vector<Lamp>& lamps() const { return lamps_; }
  Pose WorldFromCamera(double time_s) const { return camera_path_(time_s); }
  Snapshot At(double time_s) const;

 private:
  const std::string name_;
  std::vector<Body> bodies_;
  std::vector<Part> parts_;
  std::vector<Lamp> lamps_;
  CameraPath camera_path_ = [](double) { return Pose::Identity(); };
};

// The scenes of the library, in the order in which help lists them.
struct SceneInfo {
  std::string_view name;
  std::string_view phrase;  // what happens in it
};
const std::vector<SceneInfo>& SceneList();

// InvalidArgument with the list of names if there is no such scene. `seed` varies textures, clutter and phases.
absl::StatusOr<std::unique_ptr<Scene>> MakeScene(std::string_view name, uint64_t seed);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_SCENE_H_
