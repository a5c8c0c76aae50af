// Pictures through a lens against the circle of confusion.
#include "core/synthetic/lens_render.h"

#include <algorithm>
#include <cmath>

#include "core/synthetic/render.h"
#include "core/synthetic/stage.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr Camera kCamera{.width = 96, .height = 64, .fx = 80, .fy = 80, .cx = 47.5, .cy = 31.5};

// A white patch of 2 x `half_m` at `patch_m` before a black wall at 4 m, seen along y.
Scene PatchBeforeWall(double patch_m, double half_m) {
  Scene scene("patch");
  scene.AddPart(scene.AddBody("wall"), MakeBox(40, 0.2, 40), At(0, 4.1, 0),
                {.color = LinearRgb::Zero(), .grain = 0.0F});
  scene.AddPart(scene.AddBody("patch"), MakeBox(2 * half_m, 0.002, 2 * half_m), At(0, patch_m + 0.001, 0),
                {.color = LinearRgb::Constant(100), .grain = 0.0F});
  scene.AddLamp({0, -1, 0}, 10);  // far brighter than white
  scene.SetCamera([](double) { return LookAt(Vec3::Zero(), {0, 1, 0}); });
  return scene;
}

double Linear(uint8_t code) {
  const double c = code / 255.0;
  return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
}

Image<Rgb8> Through(const Scene& scene, const ThinLens& lens, int samples) {
  return RenderThroughLens(scene, kCamera, scene.WorldFromCamera(0), 0, lens, samples, 2);
}

// What lies in the plane of focus is where and as sharp as the pinhole sees it, however wide the lens: every ray
// through a pixel meets the plane at one point. Rays are spread over the pixel, so the patch ends at pixel borders.
TEST(RenderThroughLens, SeesThePlaneOfFocusSharp) {
  const double half_m = 10 * 2.0 / kCamera.fx;
  const Image<Rgb8> image = Through(PatchBeforeWall(2.0, half_m), {.aperture_m = 0.3, .focus_m = 2.0}, 64);
  for (int y = 0; y < kCamera.height; ++y)
    for (int x = 0; x < kCamera.width; ++x) {
      const bool inside = std::abs(x - kCamera.cx) < 10 && std::abs(y - kCamera.cy) < 10;
      ASSERT_EQ(image(x, y).g, inside ? 255 : 0) << x << " " << y;
    }
}

// A small patch out of focus is a disc of radius f A / 2 |1/z_f - 1/z| pixels, and keeps its light.
TEST(RenderThroughLens, SpreadsAPointOverTheCircleOfConfusion) {
  const double half_m = 2 * 1.0 / kCamera.fx;  // 4 x 4 pixels
  const ThinLens lens{.aperture_m = 0.5, .focus_m = 2.0};
  const double radius = kCamera.fx * lens.aperture_m / 2 * std::abs(1 / lens.focus_m - 1 / 1.0);
  const Image<Rgb8> image = Through(PatchBeforeWall(1.0, half_m), lens, 256);
  double light = 0, moment = 0;
  for (int y = 0; y < kCamera.height; ++y)
    for (int x = 0; x < kCamera.width; ++x) {
      const double value = Linear(image(x, y).g), distance = std::hypot(x - kCamera.cx, y - kCamera.cy);
      light += value;
      moment += value * distance * distance;
      if (distance > radius + 3) {
        ASSERT_EQ(image(x, y).g, 0) << x << " " << y;
      }
    }
  EXPECT_NEAR(light, 16, 0.02 * 16);
  // A disc's mean squared radius is half its radius squared; that of the square patch, 16 / 6, adds to it.
  EXPECT_NEAR(moment / light, radius * radius / 2 + 16.0 / 6, 0.02 * radius * radius / 2);
}

// A wide lens sees past a nearer edge: the wall straight behind the rim of an unsharp patch is half seen.
TEST(RenderThroughLens, SeesPastSilhouettes) {
  const double half_m = 20 * 1.0 / kCamera.fx;
  const Image<Rgb8> image = Through(PatchBeforeWall(1.0, half_m), {.aperture_m = 0.2, .focus_m = 4.0}, 192);
  EXPECT_NEAR(0.5 * (Linear(image(27, 32).g) + Linear(image(28, 32).g)), 0.5, 0.02);  // the rim is at 27.5
  EXPECT_EQ(image(48, 32).g, 255);
  EXPECT_EQ(image(10, 32).g, 0);
}

TEST(RenderThroughLens, ThroughAPinholeIsTheRenderer) {
  const auto scene = *MakeScene("bounce", 1);
  const Image<Rgb8> lens = RenderThroughLens(*scene, kCamera, scene->WorldFromCamera(0.1), 0.1, {}, 1, 1);
  const Image<Rgb8> pinhole = RendererAt(*scene, kCamera, 0.1).Color(2, 1);
  EXPECT_TRUE(std::equal(lens.data(), lens.data() + lens.pixel_count(), pinhole.data()));
}

}  // namespace
}  // namespace depthtween
