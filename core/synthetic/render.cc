#include "core/synthetic/render.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

constexpr int kTile = 16;          // pixels
constexpr float kAmbient = 0.34F;  // light that comes from everywhere; lamps add about 0.8
// Shadow rays from the lamp end this share of the way before the surface, clear of it.
constexpr double kShadowEnd = 1 - 1e-3;
// Neighbouring samples whose depths differ by more than this share belong to different surfaces.
constexpr float kDepthStep = 0.03F;

// Rays from one point within an angle of a unit axis.
class Cone {
 public:
  // Around the unit directions `rays`, widened by a hair.
  Cone(const Vec3& axis, const std::array<Vec3, 4>& rays) : axis_(axis) {
    for (const Vec3& ray : rays) cos_ = std::min(cos_, axis.dot(ray));
    cos_ -= 1e-9;
    sin_ = std::sqrt(1 - cos_ * cos_);
  }

  // The angle to the ball's centre against the sum of both half angles, by their cosines.
  bool MayMeet(const Vec3& to_center, double radius) const {
    const double distance2 = to_center.squaredNorm();
    if (distance2 <= radius * radius) return true;
    return axis_.dot(to_center) >= cos_ * std::sqrt(distance2 - radius * radius) - sin_ * radius;
  }

 private:
  Vec3 axis_;
  double cos_ = 1.0, sin_ = 0.0;
};

bool MayMeet(const Cone& cone, const Affine& cone_from_world, const std::vector<Ball>& balls) {
  return std::any_of(balls.begin(), balls.end(),
                     [&](const Ball& ball) { return cone.MayMeet(cone_from_world * ball.center, ball.radius); });
}

}  // namespace

// The directions from a lamp, cut into the cells of a cube map, and the parts that may cast a shadow into each.
class LampSectors {
 public:
  LampSectors(const Scene::Lamp& lamp, const Snapshot& snapshot)
      : lamp_(lamp), snapshot_(snapshot), cells_(6 * kCells * kCells) {
    const Affine lamp_from_world(Eigen::Translation3d(-lamp.position));
    for (int face = 0; face < 6; ++face)
      for (int j = 0; j < kCells; ++j)
        for (int i = 0; i < kCells; ++i) {
          const Cone cone(Direction(face, i + 0.5, j + 0.5),
                          {Direction(face, i, j), Direction(face, i + 1, j), Direction(face, i, j + 1),
                           Direction(face, i + 1, j + 1)});
          for (int part = 0; part < static_cast<int>(snapshot.parts().size()); ++part) {
            const Snapshot::PlacedPart& placed = snapshot.parts()[part];
            if (placed.casts_shadow && MayMeet(cone, lamp_from_world, placed.balls))
              cells_[(face * kCells + j) * kCells + i].push_back(part);
          }
        }
  }

  // Irradiance from the lamp on a surface; 0 where it faces away or something stands between.
  float LightOn(const Vec3& point, const Vec3& normal) const {
    const Vec3 to_point = point - lamp_.position;
    const double facing = -normal.dot(to_point);
    if (facing <= 0) return 0.0F;
    if (snapshot_.Cast({lamp_.position, to_point}, kShadowEnd, Towards(to_point)).part >= 0) return 0.0F;
    return lamp_.strength * static_cast<float>(facing / to_point.norm());
  }

 private:
  static constexpr int kCells = 12;  // along a side of a face: 7.5 degrees each

  // Faces 2 a and 2 a + 1 look along -a and +a.
  static Vec3 Direction(int face, double i, double j) {
    const int axis = face / 2;
    Vec3 direction;
    direction[axis] = face % 2 == 0 ? -1.0 : 1.0;
    direction[(axis + 1) % 3] = 2 * i / kCells - 1;
    direction[(axis + 2) % 3] = 2 * j / kCells - 1;
    return direction.normalized();
  }
  const std::vector<int>& Towards(const Vec3& direction) const {
    int axis = 0;
    const double longest = direction.cwiseAbs().maxCoeff(&axis);
    const auto cell = [&](double component) {
      return std::clamp(static_cast<int>(0.5 * (component / longest + 1) * kCells), 0, kCells - 1);
    };
    const int face = 2 * axis + (direction[axis] > 0 ? 1 : 0);
    return cells_[(face * kCells + cell(direction[(axis + 2) % 3])) * kCells + cell(direction[(axis + 1) % 3])];
  }

  const Scene::Lamp& lamp_;
  const Snapshot& snapshot_;
  std::vector<std::vector<int>> cells_;
};

Renderer::Renderer(const Scene& scene, const Camera& camera, const Pose& world_from_camera, double time_s)
    : scene_(scene),
      camera_(camera),
      world_from_camera_(world_from_camera),
      camera_from_world_(world_from_camera.inverse()),
      snapshot_(scene.At(time_s)) {
  ListPartsPerTile();
}

Renderer RendererAt(const Scene& scene, const Camera& camera, double time_s) {
  return Renderer(scene, camera, scene.WorldFromCamera(time_s), time_s);
}

void Renderer::ListPartsPerTile() {
  tile_columns_ = (camera_.width + kTile - 1) / kTile;
  tile_rows_ = (camera_.height + kTile - 1) / kTile;
  tiles_.resize(static_cast<size_t>(tile_columns_) * tile_rows_);
  for (int row = 0; row < tile_rows_; ++row)
    for (int column = 0; column < tile_columns_; ++column) {
      const double x0 = column * kTile - 1.0, x1 = x0 + kTile + 1.0;
      const double y0 = row * kTile - 1.0, y1 = y0 + kTile + 1.0;
      const auto ray = [&](double x, double y) -> Vec3 { return camera_.Unproject({x, y}, 1.0).normalized(); };
      const Cone cone(ray(0.5 * (x0 + x1), 0.5 * (y0 + y1)), {ray(x0, y0), ray(x1, y0), ray(x0, y1), ray(x1, y1)});
      std::vector<int>& list = tiles_[row * tile_columns_ + column];
      for (int i = 0; i < static_cast<int>(snapshot_.parts().size()); ++i) {
        if (MayMeet(cone, camera_from_world_, snapshot_.parts()[i].balls)) list.push_back(i);
      }
    }
}

const std::vector<int>& Renderer::Candidates(const Vec2& pixel) const {
  const int column = std::clamp(static_cast<int>(std::floor(pixel.x() + 0.5)) / kTile, 0, tile_columns_ - 1);
  const int row = std::clamp(static_cast<int>(std::floor(pixel.y() + 0.5)) / kTile, 0, tile_rows_ - 1);
  return tiles_[row * tile_columns_ + column];
}

Ray Renderer::RayThrough(const Vec2& pixel) const {
  return {world_from_camera_.translation(), world_from_camera_.linear() * camera_.Unproject(pixel, 1.0)};
}

Hit Renderer::HitAt(const Vec2& pixel) const {
  return snapshot_.Cast(RayThrough(pixel), std::numeric_limits<double>::infinity(), Candidates(pixel));
}

double Renderer::DepthAt(const Vec2& pixel) const {
  const Hit hit = HitAt(pixel);
  return hit.part < 0 ? 0.0 : hit.s;
}

LinearRgb Renderer::AlbedoAt(const Hit& hit, double cosine) const {
  const Snapshot::PlacedPart& part = snapshot_.parts()[hit.part];
  // A pixel's width on the surface, between its narrow and its foreshortened side.
  const double footprint = hit.s / camera_.fx / std::sqrt(std::max(cosine, 0.1));
  return Albedo(*part.paint, hit.material, part.shape->PatternCoordinates(hit.material, hit.normal), footprint);
}

Renderer::Sample Renderer::Shade(const Vec2& pixel, const std::vector<LampSectors>& lamps) const {
  Sample sample;
  const Ray ray = RayThrough(pixel);
  const Hit hit = HitAt(pixel);
  if (hit.part < 0) return sample;
  const Vec3 point = ray.origin + hit.s * ray.direction;
  const Vec3 to_camera = -ray.direction.normalized();
  const Vec3 normal = snapshot_.WorldNormal(hit, to_camera);
  const double cosine = normal.dot(to_camera);
  // A sky above that is brighter than the floor below, and a little light from beside the camera.
  float light = kAmbient * (0.75F + 0.25F * static_cast<float>(normal.z())) + 0.10F * static_cast<float>(cosine);
  for (size_t i = 0; i < lamps.size(); ++i) {
    const float from_lamp = lamps[i].LightOn(point, normal);
    light += from_lamp;
    if (from_lamp > 0) sample.lit_lamps |= 1 << i;
  }
  sample.color = light * AlbedoAt(hit, cosine);
  sample.depth = static_cast<float>(hit.s);
  sample.part = hit.part;
  sample.normal = normal.cast<float>();
  return sample;
}

std::vector<LampSectors> Renderer::Lamps() const {
  std::vector<LampSectors> lamps;
  lamps.reserve(scene_.lamps().size());
  for (const Scene::Lamp& lamp : scene_.lamps()) lamps.emplace_back(lamp, snapshot_);
  return lamps;
}

Image<Float3> Renderer::Light(int threads) const {
  Image<Float3> out(camera_.width, camera_.height);
  const std::vector<LampSectors> lamps = Lamps();
  ParallelRows(camera_.height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < camera_.width; ++x) {
        const LinearRgb color = Shade(Vec2(x, y), lamps).color.min(1.0F);
        out(x, y) = {color[0], color[1], color[2]};
      }
  });
  return out;
}

Image<Rgb8> Renderer::Color(int threads, int edge_samples) const {
  const int width = camera_.width, height = camera_.height;
  Image<Rgb8> out(width, height);
  const std::vector<LampSectors> lamps = Lamps();
  std::vector<Sample> samples(out.pixel_count());
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) samples[static_cast<size_t>(y) * width + x] = Shade(Vec2(x, y), lamps);
  });
  const auto differ = [](const Sample& a, const Sample& b) {
    return a.part != b.part || a.lit_lamps != b.lit_lamps || a.normal.dot(b.normal) < 0.8F ||
           std::abs(a.depth - b.depth) > kDepthStep * a.depth;
  };
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const Sample* center = &samples[static_cast<size_t>(y) * width + x];
        const bool edge = (x > 0 && differ(*center, center[-1])) || (x + 1 < width && differ(*center, center[1])) ||
                          (y > 0 && differ(*center, center[-width])) ||
                          (y + 1 < height && differ(*center, center[width]));
        LinearRgb color = center->color;
        if (edge && edge_samples > 1) {
          color = LinearRgb::Zero();
          for (int j = 0; j < edge_samples; ++j)
            for (int i = 0; i < edge_samples; ++i)
              color += Shade(Vec2(x + (i + 0.5) / edge_samples - 0.5, y + (j + 0.5) / edge_samples - 0.5), lamps)
                           .color.min(1.0F);
          color /= static_cast<float>(edge_samples * edge_samples);
        }
        out(x, y) = ToSrgb(color);
      }
  });
  return out;
}

SurfaceTruth Renderer::Surface(int threads) const {
  const int width = camera_.width, height = camera_.height;
  SurfaceTruth truth{Image<float>(width, height), Image<uint8_t>(width, height), Image<float>(width, height)};
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const Hit hit = HitAt(Vec2(x, y));
        if (hit.part < 0) continue;
        const Vec3 to_camera = -RayThrough(Vec2(x, y)).direction.normalized();
        const double cosine = snapshot_.WorldNormal(hit, to_camera).dot(to_camera);
        truth.depth_m(x, y) = static_cast<float>(hit.s);
        truth.object(x, y) = static_cast<uint8_t>(snapshot_.parts()[hit.part].body + 1);
        truth.infrared(x, y) = AlbedoAt(hit, cosine).mean() * static_cast<float>(cosine);
      }
  });
  return truth;
}

MotionTruth Renderer::MotionTo(const Renderer& other, int threads) const {
  const int width = camera_.width, height = camera_.height;
  MotionTruth truth{Image<Flow2>(width, height), Image<Float3>(width, height), Image<uint8_t>(width, height),
                    Image<uint8_t>(width, height, 255)};
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const Hit hit = HitAt(Vec2(x, y));
        if (hit.part < 0) continue;
        const Vec3 here = camera_.Unproject(Vec2(x, y), hit.s);
        const Vec3 moved_world = other.snapshot_.Locate(hit.part, hit.material);
        const Vec3 there = other.camera_from_world_ * moved_world;
        if (there.z() <= 0) continue;
        const Vec2 pixel = other.camera_.Project(there);
        truth.flow(x, y) = {static_cast<float>(pixel.x() - x), static_cast<float>(pixel.y() - y)};
        truth.scene_flow(x, y) = {static_cast<float>(there.x() - here.x()), static_cast<float>(there.y() - here.y()),
                                  static_cast<float>(there.z() - here.z())};
        truth.valid(x, y) = 1;
        const bool inside = pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() < other.camera_.width - 0.5 &&
                            pixel.y() < other.camera_.height - 0.5;
        if (!inside) continue;
        const Vec3& eye = other.world_from_camera_.translation();
        const Hit nearer =
            other.snapshot_.Cast({eye, moved_world - eye}, 1 - kHiddenBehindM / there.z(), other.Candidates(pixel));
        if (nearer.part < 0) truth.occluded(x, y) = 0;
      }
  });
  return truth;
}

}  // namespace depthtween
