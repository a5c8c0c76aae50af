// Projection and its inverse must undo one another.
#include "core/geometry/camera.h"

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// Project after Unproject is the identity for any lens the iteration converges on; this one is a Kinect v1's
// (TUM RGB-D fr1), the strongest distortion among the cameras we measure on.
TEST(Camera, ProjectUndoesUnproject) {
  const Camera camera{.width = 640,
                      .height = 480,
                      .fx = 517.3,
                      .fy = 516.5,
                      .cx = 318.6,
                      .cy = 255.3,
                      .k1 = 0.2624,
                      .k2 = -0.9531,
                      .p1 = -0.0054,
                      .p2 = 0.0026,
                      .k3 = 1.1633};
  ASSERT_TRUE(camera.Validate().ok());
  for (double x : {0.0, 100.0, 318.6, 639.0})
    for (double y : {0.0, 255.3, 479.0}) {
      const Vec2 back = camera.Project(camera.Unproject({x, y}, 2.5));
      EXPECT_NEAR(back.x(), x, 1e-3);
      EXPECT_NEAR(back.y(), y, 1e-3);
    }
}

TEST(Camera, PrincipalPointLooksAlongZ) {
  const Camera camera{.width = 64, .height = 48, .fx = 60, .fy = 61, .cx = 31.5, .cy = 23.5};
  const Vec3 p = camera.Unproject({31.5, 23.5}, 2.0);
  EXPECT_EQ(p, Vec3(0, 0, 2));
  EXPECT_EQ(camera.Project({1.0, 0, 2.0}), Vec2(61.5, 23.5));
}

}  // namespace
}  // namespace depthtween
