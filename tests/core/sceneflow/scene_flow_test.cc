// Scene flow of painted planes and bars whose motion is known in closed form.
#include "core/sceneflow/scene_flow.h"

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "core/sceneflow/flow_and_depth.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

constexpr int kWidth = 120, kHeight = 96;

Camera TestCamera() { return {.width = kWidth, .height = kHeight, .fx = 110, .fy = 110, .cx = 59.5, .cy = 47.5}; }

// A flat texture in metres that repeats nowhere in sight: waves in several directions, the longer the stronger, as in
// pictures of the world.
constexpr int kPlain = -1;  // a seed: no texture at all
Rgb8 Paint(double x, double y, int seed) {
  if (seed == kPlain) return {200, 40, 60};
  const auto wave = [&](double fx, double fy, double phase) { return std::sin(fx * x + fy * y + phase + seed); };
  const auto level = [](double coarse, double middle, double fine) {
    return static_cast<uint8_t>(std::lround(127.5 + 55 * coarse + 35 * middle + 20 * fine));
  };
  return {level(wave(5, 3, 0), wave(-11, 15, 1), wave(37, 31, 2)),
          level(wave(-3, 6, 3), wave(17, 9, 4), wave(-37, 41, 5)),
          level(wave(-5, -4, 6), wave(7, 19, 7), wave(47, -21, 8))};
}

// A painted rectangle in its own plane z = 0, `half` metres to each side of its middle, placed in the camera's frame.
struct Sheet {
  double half_x, half_y;
  int seed;
  Eigen::Isometry3d first, second;  // camera from sheet
};

struct Hit {
  double z = std::numeric_limits<double>::max();
  int sheet = -1;
  Vec3 on_sheet = Vec3::Zero();
};

Hit Cast(const std::vector<Sheet>& sheets, bool second, const Vec3& ray) {
  Hit nearest;
  for (size_t i = 0; i < sheets.size(); ++i) {
    const Eigen::Isometry3d& pose = second ? sheets[i].second : sheets[i].first;
    const Vec3 normal = pose.linear().col(2);
    const double z = normal.dot(pose.translation()) / normal.dot(ray);
    const Vec3 at = pose.inverse() * (z * ray);
    if (z > 0 && z < nearest.z && std::abs(at.x()) <= sheets[i].half_x && std::abs(at.y()) <= sheets[i].half_y)
      nearest = {z, static_cast<int>(i), at};
  }
  return nearest;
}

struct World {
  Image<Rgb8> from_color{kWidth, kHeight}, to_color{kWidth, kHeight};
  Image<float> from_m{kWidth, kHeight}, to_m{kWidth, kHeight};
  Image<Float3> motion{kWidth, kHeight};
  Image<uint8_t> hidden{kWidth, kHeight};
  Image<int> sheet{kWidth, kHeight};

  RgbdView From() const { return {from_color, from_m}; }
  RgbdView To() const { return {to_color, to_m}; }
};

// `noise` of depth: standard deviation, metres.
World Render(const std::vector<Sheet>& sheets, double noise = 0.0) {
  World world;
  const Camera camera = TestCamera();
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0.0, 1.0);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const Vec3 ray = camera.Unproject(Vec2(x, y), 1.0);
      const Hit from = Cast(sheets, false, ray), to = Cast(sheets, true, ray);
      world.from_color(x, y) = Paint(from.on_sheet.x(), from.on_sheet.y(), sheets[from.sheet].seed);
      world.to_color(x, y) = Paint(to.on_sheet.x(), to.on_sheet.y(), sheets[to.sheet].seed);
      world.from_m(x, y) = static_cast<float>(from.z + noise * normal(random));
      world.to_m(x, y) = static_cast<float>(to.z + noise * normal(random));
      world.sheet(x, y) = from.sheet;
      const Vec3 moved = sheets[from.sheet].second * from.on_sheet, motion = moved - from.z * ray;
      world.motion(x, y) = {static_cast<float>(motion.x()), static_cast<float>(motion.y()),
                            static_cast<float>(motion.z())};
      const Vec2 place = camera.Project(moved);
      const bool inside = place.x() >= 0 && place.y() >= 0 && place.x() <= kWidth - 1 && place.y() <= kHeight - 1;
      world.hidden(x, y) = !inside || Cast(sheets, true, moved / moved.z()).z < moved.z() - 1e-6 ? 1 : 0;
    }
  return world;
}

Eigen::Isometry3d At(double x, double y, double z) { return Eigen::Isometry3d(Eigen::Translation3d(x, y, z)); }
Eigen::Isometry3d Turned(const Eigen::Isometry3d& pose, double degrees, const Vec3& axis) {
  return pose * Eigen::AngleAxisd(degrees * M_PI / 180, axis.normalized());
}

// Mean |S^ - S| over the pixels that `of` names, metres; NaN of none.
double MeanError(const SceneFlow& flow, const World& world, const std::function<bool(int, int)>& of) {
  double sum = 0;
  int count = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      if (!of(x, y)) continue;
      const Float3 a = flow.motion_m(x, y), b = world.motion(x, y);
      sum += std::sqrt(std::pow(a.x - b.x, 2) + std::pow(a.y - b.y, 2) + std::pow(a.z - b.z, 2));
      ++count;
    }
  return sum / count;
}
bool Everywhere(int, int) { return true; }
bool Inside(int x, int y) { return x >= 8 && y >= 8 && x < kWidth - 8 && y < kHeight - 8; }

// A wall in front of which a board half as far moves on its own.
std::vector<Sheet> BoardBeforeWall(const Eigen::Isometry3d& board_second, const Eigen::Isometry3d& wall_second) {
  return {{3.0, 3.0, 1, At(0, 0, 2.0), wall_second}, {0.22, 0.25, 5, At(-0.1, 0, 1.0), board_second}};
}

class EveryMethod : public testing::TestWithParam<std::string> {
 protected:
  SceneFlow Estimate(const World& world) const {
    auto flow = EstimateSceneFlow(TestCamera(), world.From(), world.To(), {.method = GetParam(), .threads = 2});
    EXPECT_TRUE(flow.ok()) << flow.status();
    return *std::move(flow);
  }
};

// A wall comes 4 cm nearer and 3 cm to the side (1.7 px): known by construction. Standing still would err by 50 mm.
TEST_P(EveryMethod, FollowsATranslatingPlane) {
  const World world = Render({{3.0, 3.0, 1, At(0, 0, 2.0), At(0.03, 0, 1.96)}});
  const SceneFlow flow = Estimate(world);
  const double error = MeanError(flow, world, Inside);
  EXPECT_FALSE(!(error <= 0.004)) << error;
}

// A wall turns by 3 degrees about a slanted axis, by construction: points at the picture's edge move 50 mm, in the
// middle none.
TEST_P(EveryMethod, FollowsARotatingPlane) {
  const World world = Render({{3.0, 3.0, 1, At(0, 0, 2.0), Turned(At(0, 0, 2.0), 3, {1, 2, 1})}});
  const SceneFlow flow = Estimate(world);
  const double error = MeanError(flow, world, Inside);
  EXPECT_FALSE(!(error <= 0.006)) << error;
}

// Of every pixel: flow, motion and depth say the same thing (the moved point is seen where the flow ends), and the
// confidence of an answer is in (0,1].
TEST_P(EveryMethod, SaysOneThing) {
  const World world = Render(BoardBeforeWall(At(-0.06, 0.01, 0.97), At(0, 0, 2.0)), 0.002);
  const SceneFlow flow = Estimate(world);
  const Camera camera = TestCamera();
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      ASSERT_GT(flow.confidence(x, y), 0.0F);
      ASSERT_LE(flow.confidence(x, y), 1.0F);
      const Float3 m = flow.motion_m(x, y);
      const Vec3 moved = camera.Unproject(Vec2(x, y), flow.depth_m(x, y)) + Vec3(m.x, m.y, m.z);
      const Vec2 place = camera.Project(moved);
      ASSERT_NEAR(place.x(), x + flow.flow_px(x, y).u, 0.01) << x << "," << y;
      ASSERT_NEAR(place.y(), y + flow.flow_px(x, y).v, 0.01) << x << "," << y;
    }
}

// The same bits on one thread and on three.
TEST_P(EveryMethod, DoesNotDependOnThreads) {
  const World world = Render(BoardBeforeWall(At(-0.06, 0.01, 0.97), At(0.01, 0, 2.0)), 0.002);
  const auto one = EstimateSceneFlow(TestCamera(), world.From(), world.To(), {.method = GetParam(), .threads = 1});
  const auto three = EstimateSceneFlow(TestCamera(), world.From(), world.To(), {.method = GetParam(), .threads = 3});
  ASSERT_TRUE(one.ok() && three.ok());
  for (size_t i = 0; i < one->flow_px.pixel_count(); ++i) {
    ASSERT_EQ(one->flow_px.data()[i], three->flow_px.data()[i]);
    ASSERT_EQ(one->motion_m.data()[i].z, three->motion_m.data()[i].z);
  }
}

INSTANTIATE_TEST_SUITE_P(SceneFlow, EveryMethod, testing::ValuesIn(SceneFlowMethods()), [](const auto& info) {
  std::string name = info.param;
  std::erase(name, '-');
  return name;
});

absl::StatusOr<SceneFlow> Ours(const World& world) {
  return EstimateSceneFlow(TestCamera(), world.From(), world.To(), {.threads = 2});
}

// A board moves 44 mm before a wall that stands still; both are measured with 4 mm of noise. On the wall, of which most
// does not move at all, the error must be far below the noise; on the board near it; and what the board comes to hide,
// which no match can tell, still belongs to the wall.
TEST(RigidWindows, KeepsLayersApart) {
  const World world = Render(BoardBeforeWall(At(-0.06, 0.01, 0.985), At(0, 0, 2.0)), 0.004);
  const auto flow = Ours(world);
  ASSERT_TRUE(flow.ok()) << flow.status();
  const auto of = [&](int sheet, bool hidden) {
    return MeanError(*flow, world, [&, sheet, hidden](int x, int y) {
      return world.sheet(x, y) == sheet && (world.hidden(x, y) != 0) == hidden;
    });
  };
  EXPECT_FALSE(!(of(0, false) <= 0.002));
  EXPECT_FALSE(!(of(1, false) <= 0.006));
  EXPECT_FALSE(!(of(0, true) <= 0.01));
}

// Both surfaces move: no motion is the frame's alone.
TEST(RigidWindows, FollowsTwoMotions) {
  const World world = Render(BoardBeforeWall(Turned(At(-0.07, 0.02, 1.0), 4, {0, 0, 1}), At(0.05, 0.03, 1.97)), 0.002);
  const auto flow = Ours(world);
  ASSERT_TRUE(flow.ok()) << flow.status();
  EXPECT_FALSE(!(MeanError(*flow, world, Everywhere) <= 0.006));
}

// Truth: most pixels that the board covers are called hidden, and hardly any of those in sight. Its left side uncovers,
// its right one covers 6 px of the wall.
TEST(RigidWindows, TellsWhatBecomesHidden) {
  const World world = Render(BoardBeforeWall(At(0.0, 0, 1.0), At(0, 0, 2.0)));
  const auto flow = Ours(world);
  ASSERT_TRUE(flow.ok()) << flow.status();
  int found = 0, hidden = 0, wrong = 0, seen = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const bool said = flow->hidden(x, y) != 0;
      if (world.hidden(x, y) != 0)
        ++hidden, found += said ? 1 : 0;
      else
        ++seen, wrong += said ? 1 : 0;
    }
  ASSERT_GT(hidden, 300);
  EXPECT_GE(found, 0.7 * hidden);
  EXPECT_LE(wrong, 0.02 * seen);
}

// A camera on a stand, noise in depth: the answer is no motion, to the bit, wherever no speck of noise makes a surface
// of its own.
TEST(RigidWindows, NothingMovesOnAStand) {
  const World world = Render(BoardBeforeWall(At(-0.1, 0, 1.0), At(0, 0, 2.0)), 0.003);
  const auto flow = Ours(world);
  ASSERT_TRUE(flow.ok()) << flow.status();
  EXPECT_FALSE(!(MeanError(*flow, world, Everywhere) <= 1e-4));
}

// A board of 11 x 11 px goes 22 px, twice its own width, where dense flow, coarse to fine, sees nothing of it. Standing
// still would err by 200 mm.
TEST(RigidWindows, FindsASmallThingThatGoesFar) {
  const World world =
      Render({{3.0, 3.0, 1, At(0, 0, 2.0), At(0, 0, 2.0)}, {0.05, 0.05, 5, At(-0.1, 0, 1.0), At(0.1, 0, 1.0)}});
  const auto flow = Ours(world);
  ASSERT_TRUE(flow.ok()) << flow.status();
  const double error = MeanError(*flow, world, [&](int x, int y) { return world.sheet(x, y) == 1; });
  EXPECT_FALSE(!(error <= 0.01)) << error;
}

// A bar, 9 px wide, turns about its middle; depth has 2 mm of noise.
World TurningBar(int seed, double degrees) {
  return Render({{3.0, 3.0, 1, At(0, 0, 2.0), At(0, 0, 2.0)},
                 {0.04, 0.3, seed, At(0, 0, 1.0), Turned(At(0, 0, 1.0), degrees, {0, 0, 1})}},
                0.002);
}

// 10 degrees: by 27 mm in the mean, 5 px at its ends. Windows of dense flow, which breaks at the ends, would err by
// 13 mm; range flow proposes better.
TEST(RigidWindows, FollowsATurningBarToItsEnds) {
  const World world = TurningBar(5, 10);
  const auto flow = Ours(world);
  ASSERT_TRUE(flow.ok()) << flow.status();
  const double error = MeanError(*flow, world, [&](int x, int y) { return world.sheet(x, y) == 1; });
  EXPECT_FALSE(!(error <= 0.008)) << error;
}

// What has no texture is like itself wherever it is: the nearest place that explains it is the likeliest. Standing
// still would err by 13 mm, any place along the bar by 70.
TEST(RigidWindows, SlidesAPlainBarNoFartherThanItMust) {
  const World world = TurningBar(kPlain, 5);
  const auto flow = Ours(world);
  ASSERT_TRUE(flow.ok()) << flow.status();
  const double error = MeanError(*flow, world, [&](int x, int y) { return world.sheet(x, y) == 1; });
  EXPECT_FALSE(!(error <= 0.01)) << error;
}

// With the true flow both ways and noisy depth of both frames: in sight the motion is as true as depth averaged over a
// window allows, far below the 4 mm of noise of a pixel, and the covered strip of the wall keeps still.
TEST(FromFlowAndDepth, AveragesNoiseAndKeepsHiddenPixelsOnTheirSurface) {
  const std::vector<Sheet> there = BoardBeforeWall(At(0.0, 0, 0.99), At(0, 0, 2.0));
  std::vector<Sheet> back = there;
  for (Sheet& sheet : back) std::swap(sheet.first, sheet.second);
  const World world = Render(there, 0.004), returning = Render(back);
  const Camera camera = TestCamera();
  const auto flow_of = [&](const World& w, const World& exact) {
    Image<Flow2> flow(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const Float3 m = w.motion(x, y);
        const Vec2 place = camera.Project(camera.Unproject(Vec2(x, y), exact.from_m(x, y)) + Vec3(m.x, m.y, m.z));
        flow(x, y) = {static_cast<float>(place.x() - x), static_cast<float>(place.y() - y)};
      }
    return flow;
  };
  const Image<Flow2> next = flow_of(world, Render(there)), previous = flow_of(returning, returning);
  const SceneFlow flow = FromFlowAndDepth(PixelRays(camera), {next, previous, world.from_m, world.to_m},
                                          {.a_m = 0.004F, .b_per_m = 0.0F}, 2);
  const auto error = [&](bool hidden) {
    return MeanError(flow, world, [&, hidden](int x, int y) {
      return flow.confidence(x, y) > 0 && (world.hidden(x, y) != 0) == hidden;
    });
  };
  EXPECT_FALSE(!(error(false) <= 0.002)) << error(false);
  EXPECT_FALSE(!(error(true) <= 0.006)) << error(true);
  int hidden = 0, found = 0;
  for (size_t i = 0; i < flow.hidden.pixel_count(); ++i) {
    hidden += world.hidden.data()[i] != 0 ? 1 : 0;
    found += world.hidden.data()[i] != 0 && flow.hidden.data()[i] != 0 ? 1 : 0;
  }
  EXPECT_GE(found, 0.8 * hidden);
}

// Each refusal says what is wrong.
TEST(SceneFlow, RefusesWhatItCannotUse) {
  const World world = Render({{3.0, 3.0, 1, At(0, 0, 2.0), At(0, 0, 2.0)}});
  const Camera camera = TestCamera();
  const auto message = [&](const Camera& c, const RgbdView& from, const RgbdView& to, const SceneFlowOptions& options) {
    return std::string(EstimateSceneFlow(c, from, to, options).status().message());
  };
  EXPECT_THAT(message(camera, world.From(), world.To(), {.method = "magic"}),
              HasSubstr("method = 'magic', must be one of ours, pd-flow, sr-flow, layered-flow"));
  EXPECT_THAT(message(camera, world.From(), world.To(), {.threads = 0}), HasSubstr("threads = 0"));
  EXPECT_THAT(message(camera, world.From(), world.To(), {.noise = DepthNoise{.a_m = 0, .b_per_m = 0}}),
              HasSubstr("noise"));
  Camera wide = camera;
  wide.width = kWidth + 1;
  EXPECT_THAT(message(wide, world.From(), world.To(), {}), HasSubstr("must be 121 x 96"));
  EXPECT_THAT(message(camera, world.From(), world.To(), {.to_camera = wide}), HasSubstr("to_camera is 121 x 96"));
  const Image<float> nothing(kWidth, kHeight);
  const auto unknown = EstimateSceneFlow(camera, world.From(), {world.to_color, nothing}, {});
  EXPECT_EQ(unknown.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(unknown.status().message()), HasSubstr("second frame holds not one measurement"));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(EstimateSceneFlow(camera, world.From(), world.To(), {.stop = stop.get_token()}).status().code(),
            absl::StatusCode::kCancelled);
}

TEST(SceneFlow, EveryMethodTellsOfItsSteps) {
  const World world = Render({{3.0, 3.0, 1, At(0, 0, 2.0), At(0, 0, 2.0)}});
  for (const std::string& method : SceneFlowMethods()) {
    int steps = 0;
    ASSERT_TRUE(
        EstimateSceneFlow(TestCamera(), world.From(), world.To(), {.method = method, .on_item = [&] { ++steps; }})
            .ok());
    EXPECT_GE(steps, 2) << method;
  }
}

}  // namespace
}  // namespace depthtween
