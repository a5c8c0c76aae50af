// What a camera sees of a scene at one instant, and where everything it sees goes: colour, exact depth, objects,
// optical flow, scene flow, occlusion.
//
// Pixels are seen along the ray through their centre, so all truth is exact there; colour is averaged over the pixel.
// Threads: a Renderer is immutable; all methods are safe to call concurrently. Results do not depend on `threads`.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_RENDER_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_RENDER_H_

#include <cstdint>
#include <vector>

#include "core/base/float3.h"
#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/synthetic/scene.h"

namespace depthtween {

// What the sensor's active light finds besides depth.
struct SurfaceTruth {
  Image<float> depth_m;   // along z; 0 where the ray meets nothing
  Image<uint8_t> object;  // 1 + index into Scene::bodies(); 0 = nothing
  Image<float> infrared;  // albedo x cosine of incidence: how strongly a light beside the camera comes back
};

// From the pixels of one view to another view.
struct MotionTruth {
  Image<Flow2> flow;         // pixels
  Image<Float3> scene_flow;  // metres: the point in the other camera's frame minus the point in this camera's frame
  Image<uint8_t> valid;      // 1 = there is a surface and it stays in front of the other camera; else the rest is 0
  Image<uint8_t> occluded;   // 255 = hidden or outside the image in the other view, or not valid
};

class LampSectors;

class Renderer {
 public:
  // A surface more than this behind another is hidden. Far above rounding, far below any sensor's noise.
  static constexpr double kHiddenBehindM = 0.001;

  // `scene` must outlive the renderer. The pose may be any, not only the scene's own camera path.
  Renderer(const Scene& scene, const Camera& camera, const Pose& world_from_camera, double time_s);

  // 8-bit sRGB without sensor noise. Pixels on edges of surfaces or shadows are averaged over a grid of
  // `edge_samples` x `edge_samples` rays (>= 1); inside surfaces the paint itself is band-limited.
  Image<Rgb8> Color(int threads, int edge_samples = 3) const;
  // Linear light along the one ray through each pixel's centre, no brighter than white: for those who average many.
  Image<Float3> Light(int threads) const;
  SurfaceTruth Surface(int threads) const;
  MotionTruth MotionTo(const Renderer& other, int threads) const;

  // Exact depth at any place of the image plane, 0 where the ray meets nothing.
  double DepthAt(const Vec2& pixel) const;

 private:
  struct Sample {
    LinearRgb color = LinearRgb::Zero();
    float depth = 0.0F;
    int part = -1;
    int lit_lamps = 0;  // one bit per lamp
    Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  };
  void ListPartsPerTile();
  const std::vector<int>& Candidates(const Vec2& pixel) const;
  Ray RayThrough(const Vec2& pixel) const;
  // With unit z in the camera's frame, so that a hit's s is its depth.
  Hit HitAt(const Vec2& pixel) const;
  LinearRgb AlbedoAt(const Hit& hit, double cosine) const;
  std::vector<LampSectors> Lamps() const;
  Sample Shade(const Vec2& pixel, const std::vector<LampSectors>& lamps) const;

  const Scene& scene_;
  const Camera camera_;
  const Pose world_from_camera_, camera_from_world_;
  const Snapshot snapshot_;
  int tile_columns_ = 0, tile_rows_ = 0;
  std::vector<std::vector<int>> tiles_;  // parts that may be seen in each tile, ascending
};

// The view along the scene's own camera path.
Renderer RendererAt(const Scene& scene, const Camera& camera, double time_s);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_RENDER_H_
