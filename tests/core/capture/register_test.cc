// Scenes of the library are seen by a depth camera that stands beside the colour camera, or has another lens, so where
// each depth pixel belongs is known exactly from both cameras.
#include "core/capture/register.h"

#include <algorithm>
#include <cmath>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/capture/moving_discs.h"
#include "tests/core/capture/rig_source.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

// The largest error of a displacement, over the middle of the image and points half way to its corners, and over depths
// around the edges'.
double WorstPx(const RigSource& source, const Registration& registration) {
  const int width = source.sequence().camera.width, height = source.sequence().camera.height;
  double worst = 0;
  for (const double across : {-0.5, 0.0, 0.5})
    for (const double down : {-0.5, 0.0, 0.5})
      for (const double nearer : {0.8, 1.0, 1.25}) {
        const double x = (0.5 + 0.5 * across) * (width - 1), y = (0.5 + 0.5 * down) * (height - 1);
        const double z = registration.reference_m / nearer;
        const Flow2 move = registration.Displacement(width, height, x, y, z);
        worst = std::max(worst, (source.Seen(x, y, z) - Vec2(x + move.u, y + move.v)).norm());
      }
  return worst;
}

RegistrationEstimate Estimate(const FrameSource& source, int threads = 2) {
  const auto estimate = EstimateRegistration(source, {.threads = threads});
  EXPECT_TRUE(estimate.ok()) << estimate.status();
  return estimate.value_or(RegistrationEstimate{.reason = "failed"});
}

class RegisterRig : public testing::TestWithParam<Rig> {};

// Half a pixel, as the project asks.
TEST_P(RegisterRig, IsRecovered) {
  const RigSource source(GetParam());
  const RegistrationEstimate estimate = Estimate(source);
  EXPECT_EQ(estimate.reason, "");
  EXPECT_LT(WorstPx(source, estimate.model), 0.5) << Summary(estimate);
  const Rig& rig = GetParam();
  const bool planted = rig.right_px != 0 || rig.down_px != 0 || rig.scale != 1 || rig.beside_m != 0;
  EXPECT_EQ(estimate.IsOff(), planted) << Summary(estimate);
}

INSTANTIATE_TEST_SUITE_P(OfTheLibrary, RegisterRig,
                         testing::Values(Rig{.scene = "pan"}, Rig{.scene = "kick", .right_px = 3},
                                         Rig{.scene = "bounce", .right_px = 20, .down_px = -6},
                                         Rig{.scene = "cloth", .right_px = -7, .down_px = 12},
                                         Rig{.scene = "pan", .down_px = 5, .beside_m = 0.06},
                                         Rig{.scene = "turntable", .right_px = 4, .scale = 0.9, .beside_m = -0.03}),
                         [](const testing::TestParamInfo<Rig>& info) {
                           return info.param.scene + std::to_string(info.index);
                         });

// A number that depends on threads would make results depend on them.
TEST(Register, ThreadsChangeNoBit) {
  const MovingDiscs source({.seconds = 0.5});
  const RegistrationEstimate one = Estimate(source, 1), two = Estimate(source, 2);
  EXPECT_EQ(one.model.right_px, two.model.right_px);
  EXPECT_EQ(one.model.parallax_x_px_m, two.model.parallax_x_px_m);
  EXPECT_EQ(one.moves_sigma_px, two.moves_sigma_px);
}

// One card at one depth in two frames: its shift is told, and a parallax, which nothing tells, is taken for none.
TEST(Register, ASmallClipTellsAShift) {
  constexpr int kSide = 120, kOff = 5;
  Sequence sequence{.camera = {.width = kSide, .height = kSide, .fx = 100, .fy = 100, .cx = 59.5, .cy = 59.5}};
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth_m;
  for (int i = 0; i < 2; ++i) {
    sequence.color.push_back({i * 4'000'000, "c"});
    sequence.depth.push_back({i * 4'000'000, "d"});
    Image<Rgb8>& picture = color.emplace_back(kSide, kSide);
    Image<float>& depth = depth_m.emplace_back(kSide, kSide, 2.0F);
    const auto on_card = [i](int x, int y) { return x >= 30 + i && x < 80 + i && y >= 40 && y < 90; };
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const auto paint = static_cast<uint8_t>((on_card(x, y) ? 170 : 70) + 6 * std::sin(0.8 * x) * std::cos(0.7 * y));
        picture(x, y) = {paint, paint, paint};
        if (on_card(x - kOff, y)) depth(x, y) = 1.0F;
      }
  }
  const RegistrationEstimate estimate =
      Estimate(MemorySource(std::move(sequence), std::move(color), std::move(depth_m)));
  EXPECT_TRUE(estimate.IsOff()) << Summary(estimate);
  EXPECT_NEAR(estimate.model.right_px, -kOff, 0.5);
  EXPECT_NEAR(estimate.model.down_px, 0, 0.5);
  EXPECT_EQ(estimate.model.parallax_x_px_m, 0);
  EXPECT_EQ(estimate.model.parallax_y_px_m, 0);
}

// A depth scale of nonsense: depths of next to nothing beside others. Whatever is said of it is a number.
TEST(Register, DepthBeyondAllReasonIsNotMoved) {
  class Nonsense : public MovingDiscs {
   public:
    using MovingDiscs::MovingDiscs;
    absl::StatusOr<Image<float>> Depth(int index) const override {
      ASSIGN_OR_RETURN(Image<float> depth, MovingDiscs::Depth(index));
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth / 2; ++x) depth(x, y) *= 1e-30F;
      return depth;
    }
  };
  const RegistrationEstimate estimate = Estimate(Nonsense({.seconds = 0.2}));
  EXPECT_FALSE(estimate.IsOff()) << Summary(estimate);
  for (const double number : {estimate.moves_px, estimate.moves_sigma_px, estimate.shift_sigma_px, estimate.scale_sigma,
                              estimate.parallax_sigma_px_m, estimate.model.right_px, estimate.model.scale})
    EXPECT_TRUE(std::isfinite(number));
}

// A wall has no edges: said, not guessed, and nothing is moved.
TEST(Register, AWallTellsNothing) {
  Sequence sequence{.camera = {.width = 64, .height = 48, .fx = 50, .fy = 50, .cx = 32, .cy = 24},
                    .color = {{0, "c"}},
                    .depth = {{0, "d"}}};
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth_m;
  color.emplace_back(64, 48, Rgb8{90, 90, 90});
  depth_m.emplace_back(64, 48, 2.0F);
  const MemorySource wall(std::move(sequence), std::move(color), std::move(depth_m));
  const RegistrationEstimate estimate = Estimate(wall);
  EXPECT_EQ(estimate.reason, "no depth frame has an edge");
  EXPECT_FALSE(estimate.IsOff());
}

// Depth of another recording: its edges meet colour nowhere in particular.
TEST(Register, UnrelatedDepthIsNotMoved) {
  class Unrelated : public MovingDiscs {
   public:
    using MovingDiscs::MovingDiscs;
    absl::StatusOr<Image<Rgb8>> Color(int index) const override {
      Image<Rgb8> color(kWidth, kHeight);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
          const auto level = static_cast<uint8_t>(128 + 60 * std::sin(0.37 * x + 0.1 * index) * std::sin(0.29 * y));
          color(x, y) = {level, level, level};
        }
      return color;
    }
  };
  const RegistrationEstimate estimate = Estimate(Unrelated({.seconds = 0.5}));
  EXPECT_FALSE(estimate.IsOff()) << Summary(estimate);
}

TEST(Register, DepthOfAnotherSceneTellsNothing) {
  class OfTwoScenes : public FrameSource {
   public:
    const Sequence& sequence() const override { return color_.sequence(); }
    absl::StatusOr<Image<Rgb8>> Color(int index) const override { return color_.Color(index); }
    absl::StatusOr<Image<float>> Depth(int index) const override { return depth_.Depth(index); }

   private:
    const RigSource color_{Rig{.scene = "kick"}}, depth_{Rig{.scene = "bounce"}};
  };
  const RegistrationEstimate estimate = Estimate(OfTwoScenes());
  EXPECT_THAT(estimate.reason, HasSubstr("no shift, scale and parallax")) << Summary(estimate);
}

TEST(Register, RefusesOptionsAndStops) {
  const MovingDiscs clip({.seconds = 0.1});
  EXPECT_THAT(std::string(EstimateRegistration(clip, {.max_keys = 0}).status().message()),
              HasSubstr("max_keys = 0, must be > 0"));
  EXPECT_THAT(std::string(EstimateRegistration(clip, {.threads = 0}).status().message()),
              HasSubstr("threads = 0, must be > 0"));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(EstimateRegistration(clip, {.stop = stop.get_token()}).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace depthtween
