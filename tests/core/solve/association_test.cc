// A wall at 2 m, facing the camera, with a box at 1.5 m before it: partners are known by construction.
#include "core/solve/association.h"

#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr Camera kCamera{.width = 40, .height = 30, .fx = 50, .fy = 50, .cx = 19.5, .cy = 14.5};
constexpr Rgb8 kWall{100, 120, 90}, kBox{200, 40, 40};

class FindPartnerTest : public testing::Test {
 protected:
  FindPartnerTest() : pixels_(kCamera), depth_(40, 30, 2.0F), color_(40, 30, kWall) {
    for (int y = 10; y < 20; ++y)
      for (int x = 10; x < 20; ++x) depth_(x, y) = 1.5F, color_(x, y) = kBox;
  }
  PartnerSurface surface() const { return {depth_, color_, &pixels_, {}, 2}; }
  IdealPixels pixels_;
  Image<float> depth_;
  Image<Rgb8> color_;
};

TEST_F(FindPartnerTest, TakesTheSurfaceAtThePredictedPixel) {
  const auto partner = FindPartner(surface(), pixels_.PointAt(30.25F, 8.5F, 2.1F), {0, 0, -1}, kWall);
  ASSERT_TRUE(partner.has_value());
  EXPECT_NEAR(partner->point.z, 2.0, 1e-5);
  EXPECT_NEAR(partner->point.x, pixels_.PointAt(30.25F, 8.5F, 2.0F).x, 1e-5);
  EXPECT_NEAR(partner->normal.z, -1, 1e-5);
}

TEST_F(FindPartnerTest, RefusesAnotherLayerAnotherFacingAnotherColour) {
  EXPECT_FALSE(FindPartner(surface(), pixels_.PointAt(15, 15, 2.0F), {0, 0, -1}, kBox));
  EXPECT_FALSE(FindPartner(surface(), pixels_.PointAt(30, 8, 2.0F), {0.8F, 0, -0.6F}, kWall));
  EXPECT_FALSE(FindPartner(surface(), pixels_.PointAt(30, 8, 2.0F), {0, 0, -1}, kBox));
  EXPECT_FALSE(FindPartner(surface(), pixels_.PointAt(60, 8, 2.0F), {0, 0, -1}, kWall));
}

// Predicted one pixel inside the box, but on the wall and of its colour: the wall beside it.
TEST_F(FindPartnerTest, LooksAround) {
  const auto partner = FindPartner(surface(), pixels_.PointAt(19, 15, 2.0F), {}, kWall);
  ASSERT_TRUE(partner.has_value());
  EXPECT_NEAR(partner->point.z, 2.0, 1e-5);
}

// From in front of the wall, beside the box: the wall, straight ahead. From just behind the box's edge: the edge.
TEST_F(FindPartnerTest, ClosestIsClosestInSpace) {
  const auto wall = ClosestPartner(surface(), pixels_.PointAt(30, 15, 1.95F));
  ASSERT_TRUE(wall.has_value());
  EXPECT_NEAR(wall->point.z, 2.0, 1e-5);
  EXPECT_NEAR(wall->point.x, pixels_.PointAt(30, 15, 1.95F).x, 0.02);
  EXPECT_NEAR(wall->normal.z, -1, 1e-5);
  const auto box = ClosestPartner(surface(), pixels_.PointAt(21, 15, 1.52F));
  ASSERT_TRUE(box.has_value());
  EXPECT_NEAR(box->point.z, 1.5, 1e-5);
  EXPECT_FALSE(ClosestPartner(surface(), pixels_.PointAt(90, 15, 2.0F)));
}

}  // namespace
}  // namespace depthtween
