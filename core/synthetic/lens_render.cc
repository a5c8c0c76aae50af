#include "core/synthetic/lens_render.h"

#include <cassert>
#include <cmath>

#include "core/synthetic/render.h"

namespace depthtween {
namespace {

// Samples that fill a disc, and a square, evenly: Vogel's sunflower, and Roberts' generalisation of the golden ratio.
Vec2 OnUnitDisc(int i, int count) {
  constexpr double kGoldenAngle = 2.399963229728653;
  return std::sqrt((i + 0.5) / count) * Vec2(std::cos(kGoldenAngle * i), std::sin(kGoldenAngle * i));
}
Vec2 WithinPixel(int i) {
  const auto fraction = [](double a) { return a - std::floor(a); };
  return {fraction(0.5 + 0.7548776662466927 * i) - 0.5, fraction(0.5 + 0.5698402909980532 * i) - 0.5};
}

}  // namespace

Image<Rgb8> RenderThroughLens(const Scene& scene, const Camera& camera, const Pose& world_from_camera, double time_s,
                              const ThinLens& lens, int samples, int threads) {
  assert(!camera.HasDistortion() && samples >= 1);
  Image<Float3> sum(camera.width, camera.height);
  for (int i = 0; i < samples; ++i) {
    const Vec2 offset_m = 0.5 * lens.aperture_m * OnUnitDisc(i, samples);
    // The image plane slides so that the plane in focus stays where it is. All pixels share a sample's place in the
    // pixel, which sets the picture off by as much.
    const Vec2 within = samples > 1 ? WithinPixel(i) : Vec2::Zero();
    Camera shifted = camera;
    shifted.cx += camera.fx * offset_m.x() / lens.focus_m - within.x();
    shifted.cy += camera.fy * offset_m.y() / lens.focus_m - within.y();
    const Pose pose = world_from_camera * Eigen::Translation3d(offset_m.x(), offset_m.y(), 0);
    const Image<Float3> light = Renderer(scene, shifted, pose, time_s).Light(threads);
    for (size_t p = 0; p < sum.pixel_count(); ++p) {
      sum.data()[p].x += light.data()[p].x;
      sum.data()[p].y += light.data()[p].y;
      sum.data()[p].z += light.data()[p].z;
    }
  }
  Image<Rgb8> out(camera.width, camera.height);
  for (size_t p = 0; p < out.pixel_count(); ++p) {
    const Float3& total = sum.data()[p];
    out.data()[p] = ToSrgb(LinearRgb(total.x, total.y, total.z) / static_cast<float>(samples));
  }
  return out;
}

}  // namespace depthtween
