// Rigid motions fitted to matches that were made by a known one.
#include "core/sceneflow/rigid_motion.h"

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "core/sceneflow/frame_pair.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

const PixelRays& Rays() {
  static const auto* const kRays =
      new PixelRays({.width = 64, .height = 48, .fx = 60, .fy = 60, .cx = 31.5, .cy = 23.5, .k1 = 0.0});
  return *kRays;
}

RigidMotion Motion(double degrees, const Vec3& axis, const Float3& translation) {
  const Eigen::Matrix3d r = Eigen::AngleAxisd(degrees * M_PI / 180, axis.normalized()).toRotationMatrix();
  RigidMotion motion{.translation = translation};
  for (int i = 0; i < 9; ++i) motion.rotation[i] = static_cast<float>(r(i / 3, i % 3));
  return motion;
}

std::vector<PointMatch> Matches(const RigidMotion& motion, int wrong_in_ten) {
  std::vector<PointMatch> matches;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> depth(1.0F, 2.0F), off(-20.0F, 20.0F);
  for (int y = 2; y < 48; y += 4)
    for (int x = 2; x < 64; x += 4) {
      PointMatch match{.point = Rays().Point(x, y, depth(random))};
      const Float3 moved = motion * match.point;
      match.place = Rays().Project(moved);
      match.depth_m = moved.z;
      if (static_cast<int>(random() % 10) < wrong_in_ten) match.place = {match.place.u + off(random), match.place.v};
      matches.push_back(match);
    }
  return matches;
}

// The largest distance between where two motions put the points of a frame, metres.
float Apart(const RigidMotion& a, const RigidMotion& b) {
  float most = 0.0F;
  for (const PointMatch& match : Matches(RigidMotion(), 0)) {
    const Float3 d = a * match.point - b * match.point;
    most = std::max(most, std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z));
  }
  return most;
}

// Exact matches of a known motion give that motion back.
TEST(FitRigidMotion, RecoversAMotion) {
  const RigidMotion truth = Motion(5, {1, -2, 0.5}, {0.03F, -0.02F, 0.05F});
  const RigidFit fit = FitRigidMotion(Rays(), Matches(truth, 0), RigidMotion(), {.iterations = 20});
  EXPECT_FALSE(!(Apart(fit.motion, truth) <= 1e-3F));
  EXPECT_NEAR(fit.support, fit.possible, 0.01F * fit.possible);
}

// A third of the matches lead anywhere: the fit ignores them and says that they do not agree.
TEST(FitRigidMotion, IgnoresWrongMatches) {
  const RigidMotion truth = Motion(2, {0, 1, 0}, {0.01F, 0.0F, -0.03F});
  const std::vector<PointMatch> matches = Matches(truth, 3);
  const RigidFit fit = FitRigidMotion(Rays(), matches, RigidMotion(), {.iterations = 30});
  EXPECT_FALSE(!(Apart(fit.motion, truth) <= 3e-3F));
  EXPECT_GE(fit.support, 0.6F * fit.possible);
  EXPECT_LE(fit.support, 0.85F * fit.possible);
}

// Along an edge texture says nothing: places that are wrong only in that direction (v) do not disturb the fit.
TEST(FitRigidMotion, CountsOnlyWhatTextureDetermines) {
  const RigidMotion truth = RigidMotion::Translation({0.02F, 0.0F, 0.0F});
  std::vector<PointMatch> matches = Matches(truth, 0);
  for (size_t i = 0; i < matches.size(); ++i) {
    if (i % 2 == 0) continue;
    matches[i].place.v += 0.5F;
    matches[i].information = {1.0F, 0.0F, 0.0F};
  }
  const RigidFit fit = FitRigidMotion(Rays(), matches, RigidMotion(), {.iterations = 20});
  EXPECT_FALSE(!(Apart(fit.motion, truth) <= 1e-3F));
}

// No match, no change.
TEST(FitRigidMotion, StaysWithoutMatches) {
  const RigidMotion start = Motion(1, {1, 0, 0}, {0.1F, 0.2F, 0.3F});
  const RigidFit fit = FitRigidMotion(Rays(), {}, start, {});
  EXPECT_TRUE(fit.motion == start);
  EXPECT_EQ(fit.support, 0.0F);
}

// Through a lens with distortion, points and pixels stay each other's inverse, and what is behind the camera is nowhere
// in the picture.
TEST(PixelRays, InverseThroughALens) {
  const Camera camera{.width = 64, .height = 48, .fx = 60, .fy = 58, .cx = 30, .cy = 25, .k1 = -0.1, .k2 = 0.02};
  const PixelRays rays(camera);
  for (const auto& [x, y] : {std::pair{0, 0}, std::pair{63, 47}, std::pair{20, 30}}) {
    const Flow2 place = rays.Project(rays.Point(x, y, 1.7F));
    EXPECT_NEAR(place.u, x, 1e-3);
    EXPECT_NEAR(place.v, y, 1e-3);
    const Float3 between = rays.PointAt(static_cast<float>(x) + 0.25F, static_cast<float>(y) - 0.25F, 1.7F);
    EXPECT_NEAR(rays.Project(between).u, x + 0.25, 1e-3);
    EXPECT_TRUE(rays.Inside(place));
  }
  EXPECT_FALSE(rays.Inside(rays.Project({0.0F, 0.0F, -1.0F})));
}

// A step from 1 m to 2 m between columns 3 and 4: no value in between is ever given; on a slant 1 / z is linear.
TEST(SampleSurface, MixesNoTwoSurfaces) {
  Image<float> step(8, 4), slant(8, 4);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 8; ++x) {
      step(x, y) = x < 4 ? 1.0F : 2.0F;
      slant(x, y) = 1.0F / (0.5F + 0.004F * static_cast<float>(x));
    }
  const DepthNoise noise{.a_m = 0.001F, .b_per_m = 0.0F};
  EXPECT_EQ(SampleSurface(step, 3.4F, 1.5F, noise), 1.0F);
  EXPECT_EQ(SampleSurface(step, 3.6F, 1.5F, noise), 2.0F);
  EXPECT_NEAR(SampleSurface(slant, 2.25F, 1.0F, noise), 1.0F / 0.509F, 1e-5);
  EXPECT_EQ(SampleSurface(step, -5.0F, 9.0F, noise), 1.0F);
}

}  // namespace
}  // namespace depthtween
