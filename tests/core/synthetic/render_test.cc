// The synthetic world must agree with itself: depth, flow and scene flow of two times tell the same.
#include "core/synthetic/render.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/synthetic/stage.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr Camera kRenderCamera{.width = 160, .height = 132, .fx = 114, .fy = 114, .cx = 79.5, .cy = 65.5};

std::unique_ptr<Scene> Make(std::string_view name, uint64_t seed = 1) { return *MakeScene(name, seed); }

// Whether the four pixels around a place show one object without a depth jump.
bool WithinOneSurface(const SurfaceTruth& surface, float u, float v, int object) {
  const int x0 = static_cast<int>(std::floor(u)), y0 = static_cast<int>(std::floor(v));
  if (x0 < 0 || y0 < 0 || x0 + 1 >= kRenderCamera.width || y0 + 1 >= kRenderCamera.height) return false;
  float low = 1e9F, high = 0.0F;
  for (int y = y0; y <= y0 + 1; ++y)
    for (int x = x0; x <= x0 + 1; ++x) {
      if (surface.object(x, y) != object) return false;
      low = std::min(low, surface.depth_m(x, y));
      high = std::max(high, surface.depth_m(x, y));
    }
  return high - low < 0.05F * low;
}

double SampleInverse(const Image<float>& depth_m, float u, float v) {
  const int x0 = static_cast<int>(std::floor(u)), y0 = static_cast<int>(std::floor(v));
  const double a = u - x0, b = v - y0;
  return 1 / ((1 - b) * ((1 - a) / depth_m(x0, y0) + a / depth_m(x0 + 1, y0)) +
              b * ((1 - a) / depth_m(x0, y0 + 1) + a / depth_m(x0 + 1, y0 + 1)));
}

class EveryScene : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Scenes, EveryScene, testing::Values("bounce", "kick", "cloth", "turntable", "pan", "still"),
                         [](const auto& info) { return info.param; });

TEST(SceneList, NamesTheScenesTestedHere) {
  std::vector<std::string> names;
  for (const SceneInfo& scene : SceneList()) names.emplace_back(scene.name);
  EXPECT_THAT(names, testing::ElementsAre("bounce", "kick", "cloth", "turntable", "pan", "still"));
  EXPECT_THAT(MakeScene("nowhere", 1).status().message(),
              testing::HasSubstr("scene = 'nowhere', must be one of: bounce"));
}

// Without noise the world agrees with itself: a pixel's depth, moved by its own scene flow and looked up where its own
// flow says, is the depth that the other time's rendering has there, wherever it is not hidden. Known by definition.
TEST_P(EveryScene, OwnFlowWarpsOwnDepthWithoutError) {
  const auto scene = Make(GetParam());
  for (const auto& [t0, t1] :
       {std::pair{0.0, 1 / 240.0}, std::pair{0.05, 0.05 + 1 / 30.0}, std::pair{0.1, 0.1 - 1 / 30.0}}) {
    const Renderer from = RendererAt(*scene, kRenderCamera, t0), to = RendererAt(*scene, kRenderCamera, t1);
    const SurfaceTruth here = from.Surface(1), there = to.Surface(1);
    const MotionTruth motion = from.MotionTo(to, 1);
    int visible = 0, wrong = 0;
    std::vector<double> sampled_error;  // relative
    for (int y = 0; y < kRenderCamera.height; ++y)
      for (int x = 0; x < kRenderCamera.width; ++x) {
        ASSERT_GT(here.depth_m(x, y), 0) << "rooms are closed";
        ASSERT_TRUE(motion.valid(x, y));
        if (motion.occluded(x, y)) continue;
        ++visible;
        const Flow2 flow = motion.flow(x, y);
        const double expected = static_cast<double>(here.depth_m(x, y)) + motion.scene_flow(x, y).z;
        // Exactly there. A silhouette may be missed by the rounding of a flow to float, never a surface.
        const double exact = to.DepthAt({x + static_cast<double>(flow.u), y + static_cast<double>(flow.v)});
        wrong += !(std::abs(exact - expected) <= Renderer::kHiddenBehindM + 1e-4);

        // And between rendered pixels of one surface. Inverse depth is linear in the picture of a plane, so bilinear
        // sampling of it has no error but curvature.
        const float u = x + flow.u, v = y + flow.v;
        if (!WithinOneSurface(there, u, v, here.object(x, y))) continue;
        sampled_error.push_back(std::abs(SampleInverse(there.depth_m, u, v) - expected) / expected);
      }
    EXPECT_GT(visible, 0.9 * kRenderCamera.width * kRenderCamera.height);
    EXPECT_LE(wrong, 2) << "of " << visible;
    EXPECT_GT(sampled_error.size(), 0.7 * visible);
    std::sort(sampled_error.begin(), sampled_error.end());
    EXPECT_LT(sampled_error[sampled_error.size() / 2], 1e-6);
    EXPECT_LT(sampled_error[sampled_error.size() * 99 / 100], 0.005);
  }
}

// Following a point over two steps or in one must lead to the same place.
TEST_P(EveryScene, FlowsCompose) {
  const auto scene = Make(GetParam());
  const Renderer a = RendererAt(*scene, kRenderCamera, 0.03), b = RendererAt(*scene, kRenderCamera, 0.04),
                 c = RendererAt(*scene, kRenderCamera, 0.05);
  const MotionTruth ab = a.MotionTo(b, 1), bc = b.MotionTo(c, 1), ac = a.MotionTo(c, 1);
  const SurfaceTruth surface_a = a.Surface(1), surface_b = b.Surface(1);
  int compared = 0, wrong = 0;
  for (int y = 0; y < kRenderCamera.height; ++y)
    for (int x = 0; x < kRenderCamera.width; ++x) {
      if (ab.occluded(x, y)) continue;
      const float u = x + ab.flow(x, y).u, v = y + ab.flow(x, y).v;
      if (!WithinOneSurface(surface_b, u, v, surface_a.object(x, y))) continue;
      const int x0 = static_cast<int>(std::floor(u)), y0 = static_cast<int>(std::floor(v));
      Flow2 onward;
      float spread = 0.0F;
      for (int j = 0; j <= 1; ++j)
        for (int i = 0; i <= 1; ++i) {
          const float weight = (i ? u - x0 : 1 - (u - x0)) * (j ? v - y0 : 1 - (v - y0));
          const Flow2 &f = bc.flow(x0 + i, y0 + j), &first = bc.flow(x0, y0);
          onward.u += weight * f.u;
          onward.v += weight * f.v;
          spread = std::max(spread, std::hypot(f.u - first.u, f.v - first.v));
        }
      if (spread > 0.1F) continue;
      ++compared;
      const double error =
          std::hypot(ab.flow(x, y).u + onward.u - ac.flow(x, y).u, ab.flow(x, y).v + onward.v - ac.flow(x, y).v);
      wrong += !(error <= 0.05);
    }
  // A fold of cloth may put two layers of one object into four pixels.
  EXPECT_LE(wrong, 5) << "of " << compared;
  EXPECT_GT(compared, 0.5 * kRenderCamera.width * kRenderCamera.height);
}

TEST_P(EveryScene, MovesAsItsBodiesSay) {
  const auto scene = Make(GetParam());
  const Renderer a = RendererAt(*scene, kRenderCamera, 0.0), b = RendererAt(*scene, kRenderCamera, 1 / 240.0);
  const SurfaceTruth surface = a.Surface(1);
  const MotionTruth motion = a.MotionTo(b, 1);
  const bool camera_moves = !scene->WorldFromCamera(0.0).isApprox(scene->WorldFromCamera(1 / 240.0), 1e-12);
  double fastest = 0.0;
  for (int y = 0; y < kRenderCamera.height; ++y)
    for (int x = 0; x < kRenderCamera.width; ++x) {
      const double length = std::hypot(motion.flow(x, y).u, motion.flow(x, y).v);
      fastest = std::max(fastest, length);
      if (!camera_moves && !scene->bodies()[surface.object(x, y) - 1].moves) {
        ASSERT_NEAR(length, 0, 1e-6) << x << " " << y;
      }
    }
  if (GetParam() == "still") {
    EXPECT_NEAR(fastest, 0, 1e-6);
  } else {
    // Per frame at 512 pixels' width three times as much: what real 240 fps recordings show.
    EXPECT_GT(fastest, 0.5);
    EXPECT_LT(fastest, 8.0);
  }
}

TEST_P(EveryScene, IsTexturedInDaylight) {
  const auto scene = Make(GetParam());
  const Image<Rgb8> color = RendererAt(*scene, kRenderCamera, 0.02).Color(2);
  int dark = 0, bright = 0, textured = 0;
  for (int y = 0; y + 1 < kRenderCamera.height; ++y)
    for (int x = 0; x + 1 < kRenderCamera.width; ++x) {
      const int grey = (color(x, y).r + 2 * color(x, y).g + color(x, y).b) / 4;
      dark += grey < 16;
      bright += grey > 250;
      textured += std::abs(color(x, y).g - color(x + 1, y).g) + std::abs(color(x, y).g - color(x, y + 1).g) > 4;
    }
  const double pixels = kRenderCamera.width * kRenderCamera.height;
  EXPECT_LT(dark / pixels, 0.02);
  EXPECT_LT(bright / pixels, 0.02);
  EXPECT_GT(textured / pixels, 0.25);
}

TEST(Renderer, DoesNotDependOnThreads) {
  const auto scene = Make("kick");
  const Renderer view = RendererAt(*scene, kRenderCamera, 0.1);
  const Image<Rgb8> one = view.Color(1), three = view.Color(3);
  EXPECT_TRUE(std::equal(one.data(), one.data() + one.pixel_count(), three.data()));
}

TEST(Renderer, AnotherSeedHasOtherTexturesOnTheSameShapes) {
  const auto one = Make("bounce", 1), two = Make("bounce", 2);
  const Renderer a = RendererAt(*one, kRenderCamera, 0), b = RendererAt(*two, kRenderCamera, 0);
  const Image<Rgb8> color_a = a.Color(1), color_b = b.Color(1);
  const SurfaceTruth truth_a = a.Surface(1), truth_b = b.Surface(1);
  EXPECT_FALSE(std::equal(color_a.data(), color_a.data() + color_a.pixel_count(), color_b.data()));
  EXPECT_TRUE(std::equal(truth_a.depth_m.data(), truth_a.depth_m.data() + truth_a.depth_m.pixel_count(),
                         truth_b.depth_m.data()));
}

// A box 2 m away moves 0.2 m to the right before a wall 4 m away. What the wall shows and loses is plain geometry: its
// pixels whose rays pass through the box's new face, and not through its old one, become hidden.
TEST(Renderer, HidesWhatAMovingBoxComesToCover) {
  Scene scene("boxes");
  scene.AddPart(scene.AddBody("wall"), MakeBox(20, 0.2, 20), At(0, 4.1, 0), {});
  const int box = scene.AddBody("box", [](double t) { return At(0.2 * t, 2.1, 0); });
  scene.AddPart(box, MakeBox(1.0, 0.2, 0.8), Affine::Identity(), {});
  scene.SetCamera([](double) { return LookAt(Vec3::Zero(), {0, 1, 0}); });
  const Renderer before = RendererAt(scene, kRenderCamera, 0), after = RendererAt(scene, kRenderCamera, 1);
  const SurfaceTruth surface = before.Surface(1);
  const MotionTruth motion = before.MotionTo(after, 1);
  int hidden = 0;
  for (int y = 0; y < kRenderCamera.height; ++y)
    for (int x = 0; x < kRenderCamera.width; ++x) {
      const Vec3 at_face = kRenderCamera.Unproject(Vec2(x, y), 2.0);
      const bool in_height = std::abs(at_face.y()) <= 0.4;
      const bool on_box = in_height && std::abs(at_face.x()) <= 0.5;
      const bool on_moved_box = in_height && std::abs(at_face.x() - 0.2) <= 0.5;
      ASSERT_EQ(surface.object(x, y), on_box ? 2 : 1);
      EXPECT_FLOAT_EQ(surface.depth_m(x, y), on_box ? 2.0F : 4.0F);
      EXPECT_NEAR(motion.flow(x, y).u, on_box ? kRenderCamera.fx * 0.2 / 2.0 : 0.0, 1e-5);
      EXPECT_NEAR(motion.flow(x, y).v, 0, 1e-5);
      EXPECT_NEAR(motion.scene_flow(x, y).x, on_box ? 0.2 : 0.0, 1e-6);
      EXPECT_EQ(motion.occluded(x, y) != 0, !on_box && on_moved_box) << x << " " << y;
      hidden += motion.occluded(x, y) != 0;
    }
  EXPECT_GT(hidden, 400);
}

// What leaves the picture is occluded too: a camera that moves right loses its left columns.
TEST(Renderer, CountsWhatLeavesThePictureAsOccluded) {
  Scene scene("wall");
  scene.AddPart(scene.AddBody("wall"), MakeBox(40, 0.2, 40), At(0, 4.1, 0), {});
  scene.SetCamera([](double t) { return LookAt(Vec3(0.99 * t, 0, 0), Vec3(0.99 * t, 1, 0)); });
  const Renderer a = RendererAt(scene, kRenderCamera, 0), b = RendererAt(scene, kRenderCamera, 1);
  const MotionTruth motion = a.MotionTo(b, 1);
  for (int x = 0; x < kRenderCamera.width; ++x) {
    EXPECT_NEAR(motion.flow(x, 60).u, -kRenderCamera.fx * 0.99 / 4.0, 1e-4);  // 28.215 px
    EXPECT_EQ(motion.occluded(x, 60) != 0, x - 28.215 < -0.5) << x;
    EXPECT_TRUE(motion.valid(x, 60));
  }
}

// A lens bends rays, not depth: what the distorted camera sees at a pixel lies on that pixel's ray.
TEST(Renderer, FollowsADistortedLens) {
  const auto scene = Make("pan");
  Camera lens = kRenderCamera;
  lens.k1 = -0.12;
  lens.k2 = 0.03;
  lens.p1 = 0.002;
  const Renderer bent = RendererAt(*scene, lens, 0), straight = RendererAt(*scene, kRenderCamera, 0);
  for (int y = 2; y < lens.height; y += 9)
    for (int x = 2; x < lens.width; x += 9) {
      const Vec2 ideal = kRenderCamera.Project(lens.Unproject(Vec2(x, y), 1.0));
      if (ideal.x() < 0 || ideal.y() < 0 || ideal.x() > 159 || ideal.y() > 131) continue;
      EXPECT_NEAR(bent.DepthAt(Vec2(x, y)), straight.DepthAt(ideal), 1e-6);
    }
}

// Truth between two poses at one instant is parallax: depth from it must be the depth rendered.
TEST(Renderer, RendersFromAnyPose) {
  const auto scene = Make("turntable");
  const Pose left = scene->WorldFromCamera(0.2);
  const double baseline = 0.06;
  const Pose right = left * Eigen::Translation3d(baseline, 0, 0);
  const Renderer a(*scene, kRenderCamera, left, 0.2), b(*scene, kRenderCamera, right, 0.2);
  const SurfaceTruth surface = a.Surface(1);
  const MotionTruth motion = a.MotionTo(b, 1);
  for (int y = 0; y < kRenderCamera.height; ++y)
    for (int x = 0; x < kRenderCamera.width; ++x) {
      EXPECT_NEAR(-kRenderCamera.fx * baseline / motion.flow(x, y).u, surface.depth_m(x, y), 1e-3);
      EXPECT_NEAR(motion.flow(x, y).v, 0, 1e-4);
    }
}

// Bodies meet the floor and do not sink into it: the squashed ball touches it at the moment of contact.
TEST(Bounce, BallTouchesTheFloorAndStaysAboveIt) {
  const auto scene = Make("bounce");
  double lowest = 1.0;
  for (const Body& body : scene->bodies()) {
    if (body.name != "gym ball") continue;
    for (int i = 0; i < 400; ++i) {
      const Affine place = body.motion(0.005 * i);
      // The lowest point of an affine ball is its centre minus the norm of the map's last row.
      const double bottom = place.translation().z() - 0.30 * place.linear().row(2).norm();
      EXPECT_GT(bottom, -1e-9);
      lowest = std::min(lowest, bottom);
      EXPECT_NEAR(place.linear().determinant(), 1, 1e-9) << "squashing keeps the volume";
    }
  }
  EXPECT_NEAR(lowest, 0, 1e-9);
}

}  // namespace
}  // namespace depthtween
