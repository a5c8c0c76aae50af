// Against the camera itself, which undoes distortion for each pixel by itself.
#include "core/solve/ideal_pixels.h"

#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr Camera kBent{
    .width = 64, .height = 48, .fx = 60, .fy = 61, .cx = 31, .cy = 24, .k1 = 0.1, .k2 = -0.05, .p1 = 0.002};

TEST(IdealPixels, ThereAndBack) {
  const IdealPixels pixels(kBent);
  const PixelOf<float> ideal = pixels.Ideal(50, 40);
  const Vec3 ray = kBent.Unproject({50, 40}, 1.0);
  EXPECT_NEAR(ideal.u, 60 * ray.x() + 31, 1e-3);
  EXPECT_NEAR(ideal.v, 61 * ray.y() + 24, 1e-3);
  const PixelOf<float> between = pixels.Ideal(13.4F, 9.7F);
  const PixelOf<float> back = pixels.Seen(between.u, between.v);
  EXPECT_NEAR(back.u, 13.4, 0.01);
  EXPECT_NEAR(back.v, 9.7, 0.01);
  EXPECT_NEAR(pixels.PointAt(50, 40, 2).x, 2 * ray.x(), 1e-4);
}

TEST(IdealPixels, NoDistortionIsTheIdentity) {
  Camera camera = kBent;
  camera.k1 = camera.k2 = camera.p1 = 0;
  const IdealPixels pixels(camera);
  EXPECT_EQ(pixels.Ideal(7.5F, 3.25F).u, 7.5F);
  EXPECT_EQ(pixels.Seen(7.5F, 3.25F).v, 3.25F);
}

}  // namespace
}  // namespace depthtween
