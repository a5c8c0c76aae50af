// Stages and presets on clips whose depth is known at every time, drawn by formula or rendered.
#include <cmath>
#include <cstring>
#include <random>

#include "core/baselines/baselines.h"
#include "core/upsample/choose.h"
#include "core/upsample/fuse.h"
#include "core/upsample/keys.h"
#include "core/upsample/match.h"
#include "core/upsample/pipeline.h"
#include "core/upsample/uncertainty.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/upsample/drawn_clip.h"
#include "tests/core/upsample/rendered_clip.h"

namespace depthtween {
namespace {

Sequence Clip(const std::vector<double>& color_s, const std::vector<double>& depth_s) {
  Sequence s{.camera = {.width = kWidth, .height = kHeight, .fx = 90, .fy = 90, .cx = 47.5, .cy = 35.5},
             .depth_scale = 5000};
  for (const double t : color_s)
    s.color.push_back({std::llround(t * 1e9), "rgb/" + std::to_string(s.color.size()) + ".png"});
  for (const double t : depth_s)
    s.depth.push_back({std::llround(t * 1e9), "depth/" + std::to_string(s.depth.size()) + ".png"});
  return s;
}

// A textured square (1 m) that crosses a textured wall (2.5 m) at a constant speed, pixels a second.
struct Slide {
  double speed_px = 0;
  double Left(double t) const { return 30 + speed_px * t; }
  bool OnSquare(int x, int y, double t) const { return x >= Left(t) && x < Left(t) + 28 && y >= 22 && y < 52; }
  Image<Rgb8> Color(double t) const {
    Image<Rgb8> image(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const Rgb8 wall = Texture(x, y), square = Texture(2.1 * (x - Left(t)) + 400, 1.7 * y - 90);
        image(x, y) = OnSquare(x, y, t) ? Rgb8{square.b, square.r, 30} : wall;
      }
    return image;
  }
  Image<float> Depth(double t) const {
    Image<float> depth(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) depth(x, y) = OnSquare(x, y, t) ? 1.0F : 2.5F;
    return depth;
  }
  MemorySource Source(const std::vector<double>& color_s, const std::vector<double>& depth_s) const {
    std::vector<Image<Rgb8>> color;
    std::vector<Image<float>> depth;
    for (const double t : color_s) color.push_back(Color(t));
    for (const double t : depth_s) depth.push_back(Depth(t));
    return MemorySource(Clip(color_s, depth_s), std::move(color), std::move(depth));
  }
};

// A textured card, 0.9 m wide, that comes straight towards the camera before a textured wall (4 m).
struct ApproachingCard {
  double from_m = 2.0, speed_mps = 0;
  double At(double t) const { return from_m - speed_mps * t; }
  bool OnCard(int x, int y, double t) const { return std::hypot((x - 47.5) * At(t), (y - 35.5) * At(t)) < 0.45 * 90; }
  MemorySource Source(const std::vector<double>& color_s, const std::vector<double>& depth_s) const {
    std::vector<Image<Rgb8>> color;
    std::vector<Image<float>> depth;
    for (const double t : color_s) {
      Image<Rgb8>& image = color.emplace_back(kWidth, kHeight);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
          const Rgb8 card = Texture((x - 47.5) * At(t) * 0.7 + 300, (y - 35.5) * At(t) * 0.7 + 200);
          image(x, y) = OnCard(x, y, t) ? Rgb8{card.b, card.r, 30} : Texture(x, y);
        }
    }
    for (const double t : depth_s) {
      Image<float>& image = depth.emplace_back(kWidth, kHeight);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) image(x, y) = OnCard(x, y, t) ? static_cast<float>(At(t)) : 4.0F;
    }
    return MemorySource(Clip(color_s, depth_s), std::move(color), std::move(depth));
  }
};

std::vector<DepthResult> RunAll(const FrameSource& source, const RunContext& context = {},
                                const std::string& preset = "balanced") {
  std::vector<DepthResult> results;
  size_t planned = 0;
  const auto constants = EstimateClipConstants(source);
  EXPECT_TRUE(constants.ok()) << constants.status();
  const auto pipeline = MakePipeline(*PipelineOptions::ForPreset(preset));
  for (const Interval& interval : PlanIntervals(source.sequence())) {
    const auto summary = pipeline->Run(source, *constants, interval, context, [&](DepthResult result) {
      results.push_back(std::move(result));
      return absl::OkStatus();
    });
    EXPECT_TRUE(summary.ok()) << summary.status();
    EXPECT_EQ(summary->termination, "complete");
    EXPECT_EQ(summary->frames, interval.frame_count);
    planned += static_cast<size_t>(interval.frame_count);
  }
  EXPECT_GT(planned, 0U);
  EXPECT_EQ(results.size(), planned);
  return results;
}

// An image matches itself without cost, and the shifted one at its shift; outside the image nothing matches.
TEST(MatchPatch, CostsNothingWhereTheImageIsTheSame) {
  const Slide scene{.speed_px = 100};
  const MatchImage a(scene.Color(0)), b(scene.Color(0.05));  // the square moved 5 px
  for (const auto& [x, y] : {std::pair{44, 37}, std::pair{40, 30}}) {
    const MatchPatch patch(a, x, y);
    EXPECT_LT(patch.CostAt(a, x, y), 1e-3F);
    EXPECT_LT(patch.CostAt(b, x + 5.0F, y), 1.0F);
    EXPECT_GT(patch.CostAt(b, x, y), 8.0F);
    EXPECT_EQ(patch.CostAt(b, -3.0F, y), MatchPatch::kTruncation);
    EXPECT_GT(patch.CostAt(b, x, y, /*limit=*/2.0F), 2.0F);
  }
}

// Interpolation between two pixels costs what the mean of their windows would.
TEST(MatchPatch, InterpolatesBetweenPixels) {
  Image<Rgb8> ramp(40, 20);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 40; ++x)
      ramp(x, y) = {static_cast<uint8_t>(4 * x), static_cast<uint8_t>(4 * x), static_cast<uint8_t>(4 * x)};
  const MatchImage image(ramp);
  const MatchPatch patch(image, 20, 10);
  EXPECT_NEAR(patch.CostAt(image, 20.5F, 10), 2.0F, 0.01F);  // half a pixel of a ramp of 4 a pixel
  EXPECT_NEAR(patch.CostAt(image, 19.25F, 10), 3.0F, 0.01F);
}

// What two keys say half-way between them about a wall that is 2 m away in the first and `change_m` farther in the
// second, whose colours match worse.
struct WallBetweenKeys {
  static constexpr int kSide = 60;
  explicit WallBetweenKeys(float change_m) {
    for (Key& key : keys) key.distance = Image<float>(kSide, kSide);
    for (SideChoice& side : choice.sides)
      side = {Image<Flow2>(kSide, kSide), Image<float>(kSide, kSide), Image<float>(kSide, kSide, 2.0F)};
    choice.uncertain = Image<uint8_t>(kSide, kSide);
    choice.sides[1].depth_m = Image<float>(kSide, kSide, 2.0F + change_m);
    choice.sides[1].cost = Image<float>(kSide, kSide, 6.0F);
  }
  Image<float> FusedDepth() const {
    return Fuse({.keys = {&keys[0], &keys[1]}, .tau = 0.5F, .noise = {}}, choice, 2).depth_m;
  }
  Key keys[2];
  Choice choice;
};

// Depth goes with the surface, linear in time, however much better one key matches; so does what one key saw alone.
TEST(Fuse, GoesWithASurfaceThatMovesInDepth) {
  WallBetweenKeys wall(0.06F);
  for (int x = 28; x < 32; ++x) wall.choice.sides[1].depth_m(x, 30) = 0;
  const Image<float> depth = wall.FusedDepth();
  EXPECT_NEAR(depth(10, 10), 2.03F, 1e-3F);
  EXPECT_NEAR(depth(30, 30), 2.03F, 1e-3F);
  EXPECT_NEAR(WallBetweenKeys(0.2F).FusedDepth()(10, 10), 2.1F, 1e-3F);
}

// A few pixels whose answers differ while all around stands still are two surfaces: the better match.
TEST(Fuse, TakesTheBetterMatchWhereNeighboursDoNotMove) {
  WallBetweenKeys wall(0.0F);
  for (int x = 28; x < 32; ++x) wall.choice.sides[1].depth_m(x, 30) = 2.3F;
  EXPECT_EQ(wall.FusedDepth()(30, 30), 2.0F);
}

// A wall that goes from 2 m to 1.5 m is one surface if it is seen to grow by as much, and two if it is not.
TEST(Fuse, FollowsASurfaceThatGrowsAsItComesNearer) {
  WallBetweenKeys wall(-0.5F);
  EXPECT_EQ(wall.FusedDepth()(30, 30), 2.0F);
  const auto grow = [&wall](int side, float ratio) {
    for (int y = 0; y < WallBetweenKeys::kSide; ++y)
      for (int x = 0; x < WallBetweenKeys::kSide; ++x)
        wall.choice.sides[side].motion(x, y) = {(ratio - 1) * static_cast<float>(x - 30),
                                                (ratio - 1) * static_cast<float>(y - 30)};
  };
  grow(0, 1.75F / 2.0F), grow(1, 1.75F / 1.5F);
  EXPECT_NEAR(wall.FusedDepth()(30, 30), 1.75F, 1e-3F);
  grow(1, 1.75F / 2.0F);
  EXPECT_EQ(wall.FusedDepth()(30, 30), 2.0F);
}

// Two keys' answers about a wall that comes nearer by 3 cm, each with noise: the motion counts for nothing, the noise
// does, and the more of it the recording has. On top, what one pixel's answers differ by beyond that, and that one key
// or none saw it.
TEST(PredictSigma, GrowsWithWhatSpeaksAgainstADepth) {
  const auto sigma_with = [](float noise_m) {
    const auto filled = [](auto value) { return Image(60, 40, value); };
    const Image<float> depth = filled(2.0F);
    Fused fused{depth.Clone(),      filled(-0.03F),    filled(1.0F), filled(Provenance::kBoth),
                filled(uint8_t{0}), filled(uint8_t{0})};
    std::mt19937 random(2);
    for (size_t p = 0; p < fused.change_m.pixel_count(); ++p)
      fused.change_m.data()[p] += std::normal_distribution<float>(0, noise_m)(random);
    fused.change_m(30, 20) = -0.13F;  // 10 cm more
    fused.change_m(10, 10) = fused.change_m(11, 10) = fused.change_m(12, 10) = -0.03F;
    fused.provenance(11, 10) = Provenance::kOne;
    fused.provenance(12, 10) = Provenance::kInferred;
    return PredictSigma(depth, fused, DepthNoise{}, kBetweenKeys, 2);
  };
  const Image<float> sigma = sigma_with(0.002F);
  EXPECT_GT(sigma(10, 10), 0.001F);
  EXPECT_LT(sigma(10, 10), 0.01F);
  EXPECT_GT(sigma(30, 20), 0.03F);
  EXPECT_LT(sigma(30, 20), 0.1F);
  EXPECT_GT(sigma(11, 10), 2 * sigma(10, 10));
  EXPECT_GT(sigma(12, 10), 1.5F * sigma(11, 10));
  EXPECT_NEAR(sigma_with(0.006F)(10, 10) / sigma(10, 10), 3.0F, 0.6F);
}

// Beside a jump the wrong side is what one may be wrong by; where nothing tells how the keys differ, the
// sensor's noise is assumed.
TEST(PredictSigma, IsTheStepAtASilhouetteAndTheNoiseWhereNothingElseTells) {
  Image<float> depth(40, 40, 2.0F);
  for (int y = 0; y < 40; ++y)
    for (int x = 20; x < 40; ++x) depth(x, y) = 3.0F;
  const auto filled = [](auto value) { return Image(40, 40, value); };
  const Fused fused{depth.Clone(),      filled(0.0F),      filled(1.0F), filled(Provenance::kBoth),
                    filled(uint8_t{0}), filled(uint8_t{0})};
  const DepthNoise noise;
  const Image<float> sigma = PredictSigma(depth, fused, noise, kBetweenKeys, 1);
  EXPECT_GT(sigma(19, 20), 0.1F);
  EXPECT_LT(sigma(19, 20), 0.3F);
  EXPECT_GT(sigma(5, 20), noise.At(2.0F));
  EXPECT_LT(sigma(5, 20), 1.5F * noise.At(2.0F));
}

// The noise put into a flat wall is the noise found, and the median depth is the wall's.
TEST(EstimateClipConstants, FindsTheNoiseThatWasPutIn) {
  std::mt19937 random(5);
  std::vector<Image<float>> depth;
  std::vector<Image<Rgb8>> color;
  const DepthNoise truth{.a_m = 0.002F, .b_per_m = 0.001F};
  for (int k = 0; k < 4; ++k) {
    Image<float> d(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const float z = y < kHeight / 2 ? 1.2F : 2.9F;
        d(x, y) = z + truth.At(z) * std::normal_distribution<float>(0, 1)(random);
      }
    depth.push_back(std::move(d));
    color.emplace_back(kWidth, kHeight, Rgb8{90, 90, 90});
  }
  const MemorySource source(Clip({0, 0.1, 0.2, 0.3}, {0, 0.1, 0.2, 0.3}), std::move(color), std::move(depth));
  const auto constants = EstimateClipConstants(source);
  ASSERT_TRUE(constants.ok());
  const DepthNoise found{static_cast<float>(constants->noise_a_m), static_cast<float>(constants->noise_b_per_m)};
  EXPECT_NEAR(found.At(1.2F), truth.At(1.2F), 0.25F * truth.At(1.2F));
  EXPECT_NEAR(found.At(2.9F), truth.At(2.9F), 0.25F * truth.At(2.9F));
  EXPECT_TRUE(constants->warnings.empty());
}

TEST(EstimateClipConstants, WarnsOfAnImplausibleScale) {
  std::vector<Image<float>> depth;
  depth.emplace_back(kWidth, kHeight, 0.004F);
  std::vector<Image<Rgb8>> color;
  color.emplace_back(kWidth, kHeight);
  const MemorySource source(Clip({0}, {0}), std::move(color), std::move(depth));
  const auto constants = EstimateClipConstants(source);
  ASSERT_TRUE(constants.ok());
  ASSERT_EQ(constants->warnings.size(), 1U);
  EXPECT_THAT(constants->warnings[0], ::testing::HasSubstr("median depth of 0.004 m"));
}

// A depth frame belongs to the colour frame nearest in time; what lies between is a fraction of the step.
TEST(LocateKey, GivesTheNearestColourFrameAndTheRest) {
  const Sequence regular = Clip({0, 0.1, 0.2, 0.3, 0.4, 0.5}, {0.0, 0.13, 0.26, 0.39});
  EXPECT_EQ(LocateKey(regular, 0).color_index, 0);
  EXPECT_EQ(LocateKey(regular, 0).toward, -1);
  const Key between = LocateKey(regular, 1);
  EXPECT_EQ(between.color_index, 1);
  EXPECT_EQ(between.toward, 2);
  EXPECT_NEAR(between.fraction, 0.3, 1e-6);
  EXPECT_EQ(LocateKey(regular, 2).color_index, 3);
  EXPECT_EQ(LocateKey(regular, 2).toward, 2);
  EXPECT_NEAR(LocateKey(regular, 2).fraction, 0.4, 1e-6);
  EXPECT_EQ(between.time_ns, regular.depth[1].time_ns);
}

// A depth frame taken half a step after its colour frame is pulled back along the flow by half of it.
TEST(MoveDepthToColorFrame, PullsBackAlongTheFlow) {
  const Slide scene{.speed_px = 80};
  const Image<Flow2> flow(kWidth, kHeight, Flow2{8, 0});
  const Image<float> moved = MoveDepthToColorFrame(scene.Depth(0.05), flow, 0.5F);
  EXPECT_GT(ShareWithin(moved, scene.Depth(0), 1e-6F), 0.95);
}

TEST(NearDepthJumps, MarksTheSurroundingsOfAStep) {
  Image<float> depth(20, 3, 1.0F);
  for (int y = 0; y < 3; ++y)
    for (int x = 10; x < 20; ++x) depth(x, y) = 2.0F;
  const Image<uint8_t> near = NearDepthJumps(depth, 3, {}, 1);
  for (int x = 0; x < 20; ++x) EXPECT_EQ(near(x, 1), x >= 6 && x <= 12) << x;
}

// Nothing moves: every frame shows the wall and the square where they stand.
TEST(Pipeline, IsExactWhereNothingMoves) {
  const Slide scene;
  const auto results = RunAll(scene.Source({0, 0.01, 0.02, 0.03}, {0, 0.03}));
  ASSERT_EQ(results.size(), 4U);
  for (const DepthResult& r : results) {
    EXPECT_GT(ShareWithin(r.depth_m, scene.Depth(0), 1e-3F), 0.9999);
    for (size_t i = 0; i < r.depth_m.pixel_count(); ++i) {
      ASSERT_TRUE(std::isfinite(r.depth_m.data()[i]) && std::isfinite(r.sigma_m.data()[i]));
      ASSERT_GT(r.sigma_m.data()[i], 0);
    }
  }
  EXPECT_EQ(results[0].provenance(5, 5), Provenance::kMeasured);
  EXPECT_EQ(results[1].provenance(5, 5), Provenance::kBoth);
}

// The square crosses the wall by 3 px a frame; truth is known at every stamp, also with irregular stamps, a dropped
// depth frame and colour outside the depth frames.
TEST(Pipeline, FollowsASlidingSquareInTime) {
  const Slide scene{.speed_px = 300};
  const std::vector<double> color = {-0.01, 0, 0.01, 0.023, 0.031, 0.04, 0.05, 0.06, 0.07};
  const auto results = RunAll(scene.Source(color, {0, 0.06}), {.threads = 2});
  ASSERT_EQ(results.size(), color.size());
  for (size_t i = 0; i < color.size(); ++i) {
    SCOPED_TRACE(color[i]);
    EXPECT_EQ(results[i].color_index, static_cast<int>(i));
    const bool held = color[i] < 0 || color[i] > 0.06;
    EXPECT_EQ(results[i].provenance(5, 5) == Provenance::kHeld, held);
    if (!held) {
      EXPECT_GT(ShareWithin(results[i].depth_m, scene.Depth(color[i]), 0.01F), 0.985);
    }
  }
  // Held is the nearer key, unmoved.
  EXPECT_EQ(ShareWithin(results.front().depth_m, scene.Depth(0), 1e-6F), 1.0);
  EXPECT_EQ(ShareWithin(results.back().depth_m, scene.Depth(0.06), 1e-6F), 1.0);
}

// A punch at 30 depth frames a second, a walk at 5: between two keys depth goes straight, however far.
TEST(Pipeline, FollowsACardThatComesNearerOrGoesAway) {
  std::vector<double> color;
  for (int i = 0; i <= 8; ++i) color.push_back(i / 240.0);
  for (const double change_m : {0.2, 0.34, 0.5, 0.7, -0.34, -0.6}) {
    const ApproachingCard scene{.from_m = change_m > 0 ? 2.0 : 1.5, .speed_mps = change_m * 30};
    for (const DepthResult& frame : RunAll(scene.Source(color, {0, color.back()}), {}, "fast")) {
      const double t = color[static_cast<size_t>(frame.color_index)];
      int on = 0, good = 0;
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
          if (scene.OnCard(x, y, t)) {
            ++on;
            good += std::abs(frame.depth_m(x, y) - scene.At(t)) <= 0.02 * scene.At(t);
          }
      EXPECT_GT(good, 0.93 * on) << change_m << " m, frame " << frame.color_index;
    }
  }
}

// "The same bits" for any number of threads and any order of intervals is a promise of the interface.
TEST(Pipeline, GivesTheSameBitsForAnyThreadsAndOrder) {
  const Slide scene{.speed_px = 250};
  const MemorySource source = scene.Source({0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06}, {0, 0.03, 0.06});
  const auto one = RunAll(source), three = RunAll(source, {.threads = 3});
  const auto constants = EstimateClipConstants(source);
  const auto plan = PlanIntervals(source.sequence());
  std::vector<DepthResult> last;
  ASSERT_TRUE(MakePipeline()
                  ->Run(source, *constants, plan[1], {.threads = 2},
                        [&](DepthResult r) {
                          last.push_back(std::move(r));
                          return absl::OkStatus();
                        })
                  .ok());
  ASSERT_EQ(one.size(), three.size());
  for (size_t i = 0; i < one.size(); ++i) EXPECT_TRUE(SameBits(one[i], three[i])) << i;
  for (size_t i = 0; i < last.size(); ++i) EXPECT_TRUE(SameBits(last[i], one[3 + i])) << i;
}

// Preset fast follows motion from frame to frame. Truth is known as above; the second key was taken between two colour
// frames, which takes flow between these.
TEST(Pipeline, FollowsASlidingSquareFast) {
  const Slide scene{.speed_px = 300};
  const std::vector<double> color = {0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06};
  const auto results = RunAll(scene.Source(color, {0, 0.025, 0.06}), {.threads = 2}, "fast");
  ASSERT_EQ(results.size(), color.size());
  for (size_t i = 0; i < color.size(); ++i)
    EXPECT_GT(ShareWithin(results[i].depth_m, scene.Depth(color[i]), 0.01F), 0.98) << color[i];
}

// Who asks for motion gets it for every step, and the same depth.
TEST(Pipeline, GivesTheSameDepthToThoseWhoAskForMotion) {
  const MemorySource source = Slide{.speed_px = 250}.Source({0, 0.01, 0.02, 0.03, 0.04}, {0, 0.025, 0.04});
  for (const char* preset : {"fast", "balanced"}) {
    SCOPED_TRACE(preset);
    const auto without = RunAll(source, {}, preset), with = RunAll(source, {.want_motion = true}, preset);
    ASSERT_EQ(without.size(), with.size());
    for (size_t i = 0; i < with.size(); ++i) {
      EXPECT_TRUE(SameBits(without[i], with[i])) << i;
      EXPECT_TRUE(without[i].motion_next.empty()) << i;
    }
    EXPECT_NEAR(with[1].motion_next(50, 37).u, 2.5F, 0.5F);  // on the square, away from its edges
    EXPECT_NEAR(with[1].motion_back(50, 37).u, -2.5F, 0.5F);
  }
}

TEST(Pipeline, StopsWhenAsked) {
  const MemorySource source = Slide{}.Source({0, 0.01, 0.02}, {0, 0.02});
  std::stop_source stop;
  stop.request_stop();
  const auto summary = MakePipeline()->Run(source, {}, PlanIntervals(source.sequence())[0], {.stop = stop.get_token()},
                                           [](DepthResult) { return absl::OkStatus(); });
  EXPECT_EQ(summary.status().code(), absl::StatusCode::kCancelled);
}

TEST(Pipeline, PassesOnWhatTheSinkSays) {
  const MemorySource source = Slide{}.Source({0, 0.01, 0.02}, {0, 0.02});
  const auto summary = MakePipeline()->Run(source, {}, PlanIntervals(source.sequence())[0], {},
                                           [](DepthResult) { return absl::ResourceExhaustedError("disk full"); });
  EXPECT_EQ(summary.status().message(), "disk full");
}

// Keys without a single measurement give frames without an answer, not an error.
TEST(Pipeline, KnowsNothingFromEmptyKeys) {
  std::vector<Image<float>> depth;
  std::vector<Image<Rgb8>> color;
  for (int i = 0; i < 2; ++i) depth.emplace_back(kWidth, kHeight);
  for (int i = 0; i < 3; ++i) color.push_back(Slide{}.Color(0));
  const auto results = RunAll(MemorySource(Clip({0, 0.01, 0.02}, {0, 0.02}), std::move(color), std::move(depth)));
  for (const DepthResult& r : results) {
    EXPECT_EQ(r.depth_m(10, 10), 0.0F);
    EXPECT_EQ(r.provenance(10, 10), Provenance::kNone);
  }
}

// A depth frame that saw nothing, between two that saw a scene at rest: they tell its depth, and nothing was measured.
TEST(Pipeline, MeasuredNothingInAFrameWithoutDepth) {
  const Slide scene;
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth;
  for (int i = 0; i < 5; ++i) color.push_back(scene.Color(0));
  for (int i = 0; i < 3; ++i) depth.push_back(i == 1 ? Image<float>(kWidth, kHeight) : scene.Depth(0));
  const MemorySource source(Clip({0, 0.01, 0.02, 0.03, 0.04}, {0, 0.02, 0.04}), std::move(color), std::move(depth));
  const std::vector<DepthResult> results = RunAll(source);
  for (const DepthResult& frame : results) {
    int measured = 0;
    for (size_t p = 0; p < frame.provenance.pixel_count(); ++p)
      measured += frame.provenance.data()[p] == Provenance::kMeasured;
    const bool has_depth = frame.color_index == 0 || frame.color_index == 4;
    EXPECT_EQ(measured, has_depth ? kWidth * kHeight : 0) << frame.color_index;
    EXPECT_GT(ShareWithin(frame.depth_m, scene.Depth(0), 0.01F), 0.99);
  }
}

TEST(PipelineOptions, ExplainWhatIsWrong) {
  EXPECT_TRUE(PipelineOptions{}.Validate().ok());
  EXPECT_THAT(PipelineOptions{.sweeps = -1}.Validate().message(), ::testing::HasSubstr("sweeps = -1"));
  EXPECT_THAT(PipelineOptions{.median_radius = 99}.Validate().message(), ::testing::HasSubstr("median_radius = 99"));
}

// On a rendered scene with a sensor's noise, whose truth is exact: closer to it than every baseline.
TEST(PipelineOptions, EveryPartCanBeSwitchedOff) {
  for (const std::string& part : PartNames()) {
    PipelineOptions options = *PipelineOptions::ForPreset("reference");
    EXPECT_TRUE(options.Uses(part)) << part;
    ASSERT_TRUE(options.SwitchOff(part).ok()) << part;
    // Without drawn surfaces nothing is solved for, and without a solve none of its parts is used.
    const std::vector<std::string>& of_solve = SolvePartNames();
    const auto gone = [&](const std::string& other) {
      const bool solves = other == "solve" || std::find(of_solve.begin(), of_solve.end(), other) != of_solve.end();
      return other == part || (solves && (part == "draw" || part == "solve"));
    };
    for (const std::string& other : PartNames()) EXPECT_EQ(options.Uses(other), !gone(other)) << part << " " << other;
  }
  PipelineOptions options;
  EXPECT_FALSE(options.Uses("draw")) << "it earns its time in preset best alone";
  EXPECT_FALSE(options.Uses("luck"));
  EXPECT_THAT(options.SwitchOff("luck").message(), ::testing::HasSubstr("the parts are settle, recover"));
}

TEST(Pipeline, BeatsTheBaselinesOnARenderedScene) {
  const RenderedClip clip({.scene = "bounce", .frames = 9, .width = 192, .height = 160});
  const auto constants = EstimateClipConstants(clip.source());
  ASSERT_TRUE(constants.ok());
  const double ours = RmseM(*MakePipeline(), clip, *constants, Unfilled::kCountsAsError);
  for (const char* name : {"hold", "linear", "flow-warp"}) {
    const auto baseline = MakeBaseline(name);
    ASSERT_TRUE(baseline.ok());
    EXPECT_LT(ours, 0.8 * RmseM(**baseline, clip, *constants, Unfilled::kCountsAsError)) << name;
  }
}

}  // namespace
}  // namespace depthtween
