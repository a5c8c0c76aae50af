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

// The intrinsics of a camera at one resolution, with the size of another: the factor is that of the sizes.
TEST(Camera, DoubtsIntrinsicsOfAnotherResolution) {
  const Camera true_camera{.width = 1920, .height = 1440, .fx = 1200, .fy = 1200, .cx = 960, .cy = 720};
  EXPECT_TRUE(true_camera.Doubts().empty());
  for (const int factor : {2, 3, 12}) {
    Camera smaller = true_camera;
    smaller.width /= factor;
    smaller.height /= factor;
    ASSERT_EQ(smaller.Doubts().size(), 1U) << factor;
    EXPECT_THAT(smaller.Doubts()[0], testing::AllOf(testing::HasSubstr("principal point (cx = 960, cy = 720)"),
                                                    testing::HasSubstr("1920 x 1440"),
                                                    testing::HasSubstr("by " + std::to_string(factor) + " ")));
  }
  Camera larger = true_camera;
  larger.width *= 2;
  larger.height *= 2;
  EXPECT_THAT(larger.Doubts(), testing::ElementsAre(testing::HasSubstr("by 0.5 ")));
}

TEST(Camera, DoubtsWhatCamerasDoNotHave) {
  const Camera camera{.width = 640, .height = 480, .fx = 520, .fy = 520, .cx = 310, .cy = 255};
  EXPECT_TRUE(camera.Doubts().empty());
  Camera changed = camera;
  changed.cx = 700;  // and cy is fine: no other resolution explains it
  EXPECT_THAT(changed.Doubts(), testing::ElementsAre(testing::AllOf(testing::HasSubstr("lies outside the image"),
                                                                    testing::HasSubstr("Check cx and cy"))));
  changed = camera;
  changed.fx = changed.fy = 6000;  // 6.1 degrees
  EXPECT_THAT(changed.Doubts(), testing::ElementsAre(testing::HasSubstr("field of view of 6.11 degrees")));
  changed = camera;
  changed.fy = 260;
  EXPECT_THAT(changed.Doubts(), testing::ElementsAre(testing::HasSubstr("differ by a factor of 2")));
  // A crop of a larger image has its principal point off the centre, in one direction more than in the other.
  changed = camera;
  changed.cx = 200;
  EXPECT_TRUE(changed.Doubts().empty());
  EXPECT_TRUE(Camera().Doubts().empty());
}

TEST(Camera, PrincipalPointLooksAlongZ) {
  const Camera camera{.width = 64, .height = 48, .fx = 60, .fy = 61, .cx = 31.5, .cy = 23.5};
  const Vec3 p = camera.Unproject({31.5, 23.5}, 2.0);
  EXPECT_EQ(p, Vec3(0, 0, 2));
  EXPECT_EQ(camera.Project({1.0, 0, 2.0}), Vec2(61.5, 23.5));
}

}  // namespace
}  // namespace depthtween
