// Baselines on clips drawn by formula, whose depth is known at every time.
#include "core/baselines/baselines.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/baselines/per_pixel.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kWidth = 96, kHeight = 80;

// A smooth, unmistakable texture at a real-valued position.
uint8_t Texture(double x, double y) {
  const double waves = std::sin(0.35 * x) * std::cos(0.27 * y) + 0.6 * std::sin(0.11 * x + 0.17 * y) +
                       0.4 * std::cos(0.53 * x - 0.21 * y);
  return static_cast<uint8_t>(std::lround(127.5 + 60.0 * waves));
}

// A clip in memory whose colour and depth are functions of pixel and time.
struct Clip {
  std::vector<int64_t> color_ns, depth_ns;
  std::function<uint8_t(int x, int y, int64_t time_ns)> grey = [](int x, int y, int64_t) { return Texture(x, y); };
  std::function<float(int x, int y, int64_t time_ns)> depth_m = [](int, int, int64_t) { return 2.0F; };

  MemorySource Source() const {
    Sequence sequence{.camera = {.width = kWidth, .height = kHeight, .fx = 80, .fy = 80, .cx = 47.5, .cy = 39.5},
                      .depth_scale = 1000};
    std::vector<Image<Rgb8>> colors;
    std::vector<Image<float>> depths;
    for (int64_t t : color_ns) {
      sequence.color.push_back({t, "rgb/" + std::to_string(t) + ".png"});
      Image<Rgb8>& image = colors.emplace_back(kWidth, kHeight);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) image(x, y) = {grey(x, y, t), grey(x, y, t), grey(x, y, t)};
    }
    for (int64_t t : depth_ns) {
      sequence.depth.push_back({t, "depth/" + std::to_string(t) + ".png"});
      Image<float>& image = depths.emplace_back(kWidth, kHeight);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) image(x, y) = depth_m(x, y, t);
    }
    return MemorySource(std::move(sequence), std::move(colors), std::move(depths));
  }
};

// All frames of the clip by one baseline, by time stamp.
std::map<int64_t, DepthResult> Answer(std::string_view name, const FrameSource& source, int threads = 1) {
  std::map<int64_t, DepthResult> results;
  const auto baseline = MakeBaseline(name);
  EXPECT_TRUE(baseline.ok());
  EXPECT_EQ((*baseline)->name(), name);
  for (const Interval& interval : PlanIntervals(source.sequence())) {
    const auto summary =
        (*baseline)->Run(source, ClipConstants{}, interval, {.threads = threads}, [&](DepthResult result) {
          const int64_t time_ns = source.sequence().color[result.color_index].time_ns;
          results[time_ns] = std::move(result);
          return absl::OkStatus();
        });
    EXPECT_TRUE(summary.ok()) << summary.status();
    EXPECT_EQ(summary->frames, interval.frame_count);
  }
  return results;
}

TEST(Baselines, AreSevenAndOthersAreRefusedByName) {
  EXPECT_THAT(BaselineNames(),
              testing::ElementsAre("hold", "nearest", "linear", "dolson", "dolson-mode", "tracking", "flow-warp"));
  const auto unknown = MakeBaseline("magic");
  EXPECT_EQ(unknown.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(unknown.status().message(),
              testing::HasSubstr("hold, nearest, linear, dolson, dolson-mode, tracking, flow-warp"));
}

// Nothing moves and depth has no noise: every method that does not smooth must give the one depth map back, frame after
// frame.
TEST(Baselines, AreExactOnAStillScene) {
  Clip clip{.color_ns = {0, 7, 11, 20, 28, 40}, .depth_ns = {0, 20, 40}};
  clip.depth_m = [](int x, int y, int64_t) { return x < 40 ? 1.0F + 0.001F * static_cast<float>(y) : 3.0F; };
  const MemorySource source = clip.Source();
  for (const std::string& name : QuickBaselineNames()) {
    const auto results = Answer(name, source);
    ASSERT_EQ(results.size(), 6U);
    for (const auto& [time_ns, result] : results) {
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
          ASSERT_NEAR(result.depth_m(x, y), clip.depth_m(x, y, 0), 1e-6)
              << name << " " << time_ns << " " << x << " " << y;
    }
  }
}

// Colour tells two still surfaces apart by many sigmas, so even a filter that averages in colour mixes nothing: depth
// is known by construction.
TEST(Dolson, KeepsSurfacesThatColourTellsApart) {
  Clip clip{.color_ns = {0, 10, 20}, .depth_ns = {0, 20}};
  clip.grey = [](int x, int, int64_t) { return static_cast<uint8_t>(x < 40 ? 40 : 200); };
  clip.depth_m = [](int x, int, int64_t) { return x < 40 ? 1.0F : 3.0F; };
  const MemorySource source = clip.Source();
  for (const char* name : {"dolson", "dolson-mode"}) {
    const auto results = Answer(name, source);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        ASSERT_NEAR(results.at(10).depth_m(x, y), clip.depth_m(x, y, 0), 1e-3) << name << " " << x << " " << y;
  }
}

// One colour everywhere: the plain filter averages both surfaces at the edge, which is its known fault; mode seeking
// gives one of the two depths everywhere, never a mixture.
TEST(Dolson, OnlyModeSeekingNeverMixesSurfacesOfOneColour) {
  Clip clip{.color_ns = {0, 10, 20}, .depth_ns = {0, 20}};
  clip.grey = [](int, int, int64_t) { return static_cast<uint8_t>(120); };
  clip.depth_m = [](int x, int, int64_t) { return x < 40 ? 1.0F : 3.0F; };
  const MemorySource source = clip.Source();
  const auto mixed = [&](const char* name) {
    const auto results = Answer(name, source);
    int count = 0;
    for (int x = 0; x < kWidth; ++x) {
      const float z = results.at(10).depth_m(x, kHeight / 2);
      count += std::abs(z - 1.0F) > 0.05F && std::abs(z - 3.0F) > 0.05F;
    }
    return count;
  };
  EXPECT_GT(mixed("dolson"), 0);
  EXPECT_EQ(mixed("dolson-mode"), 0);
}

// A dome comes nearer and goes sideways before a wall, and no colour shows it: only tracking carries it along.
TEST(Tracking, CarriesAShapeAlongWithoutColour) {
  Clip clip{.color_ns = {0, 25, 50, 75, 100}, .depth_ns = {0, 100}};
  clip.grey = [](int, int, int64_t) { return static_cast<uint8_t>(120); };
  clip.depth_m = [](int x, int y, int64_t time_ns) {
    const double t = static_cast<double>(time_ns) / 100;
    const double dx = x - 44.0 - 3 * t, dy = y - 40.0, r2 = dx * dx + dy * dy;
    return static_cast<float>(r2 < 24 * 24 ? 1.5 - 0.1 * t + 0.2 * r2 / (24 * 24) : 3.0);
  };
  const MemorySource source = clip.Source();
  const auto error = [&](const char* name) {
    const auto results = Answer(name, source);
    double sum = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) sum += std::abs(results.at(50).depth_m(x, y) - clip.depth_m(x, y, 50));
    return sum;
  };
  EXPECT_LT(error("tracking"), 0.6 * error("hold"));
}

// Depth grows linearly with time at irregular stamps; values follow from the definitions by hand.
TEST(Baselines, FollowTimeStampsNotFrameNumbers) {
  Clip clip{.color_ns = {0, 10, 45, 90, 100, 130}, .depth_ns = {0, 100, 160}};
  clip.depth_m = [](int, int, int64_t t) { return 1.0F + 0.01F * static_cast<float>(t); };
  const MemorySource source = clip.Source();
  const auto hold = Answer("hold", source), nearest = Answer("nearest", source), linear = Answer("linear", source);
  const auto at = [](const auto& results, int64_t t) { return results.at(t).depth_m(5, 5); };
  EXPECT_FLOAT_EQ(at(hold, 90), 1.0F);
  EXPECT_FLOAT_EQ(at(hold, 100), 2.0F);
  EXPECT_FLOAT_EQ(at(nearest, 45), 1.0F);
  EXPECT_FLOAT_EQ(at(nearest, 90), 2.0F);
  EXPECT_FLOAT_EQ(at(nearest, 130), 2.0F);  // as near to both: the earlier
  for (int64_t t : {0, 10, 45, 90, 100, 130}) EXPECT_FLOAT_EQ(at(linear, t), 1.0F + 0.01F * static_cast<float>(t)) << t;
}

TEST(LinearPixel, TakesTheKnownDepthWhereOneIsUnknown) {
  EXPECT_EQ(LinearPixel(0.0F, 2.0F, 0.25).depth_m, 2.0F);
  EXPECT_EQ(LinearPixel(1.0F, 0.0F, 0.75).depth_m, 1.0F);
  EXPECT_EQ(LinearPixel(1.0F, 0.0F, 0.75).provenance, Provenance::kOne);
  EXPECT_EQ(LinearPixel(1.0F, 2.0F, 0.75).provenance, Provenance::kBoth);
  EXPECT_EQ(LinearPixel(0.0F, 0.0F, 0.75).provenance, Provenance::kNone);
}

// Outside the first and last key there is one key to go by, whatever the method: it is held, and marked so.
// Of the key at 1 m before and that of 2 m after, which knows the first pixel alone.
TEST(NearerKey, GoesFirstAtItsOwnTimeAndLastElsewhere) {
  const Image<float> before_m(2, 1, 1.0F);
  Image<float> after_m(2, 1);
  after_m(0, 0) = 2.0F;
  const PixelAnswer own = {1.5F, Provenance::kOne}, none;
  const auto at = [&](double tau, const PixelAnswer& answer, size_t pixel) {
    const PixelAnswer complete = NearerKey(before_m, after_m, tau).Complete(answer, pixel);
    return std::pair(complete.depth_m, complete.provenance);
  };
  EXPECT_EQ(at(0.0, own, 0), std::pair(1.0F, Provenance::kMeasured));
  EXPECT_EQ(at(1.0, own, 0), std::pair(2.0F, Provenance::kMeasured));
  EXPECT_EQ(at(1.0, own, 1), std::pair(1.5F, Provenance::kOne));
  EXPECT_EQ(at(0.5, own, 0), std::pair(1.5F, Provenance::kOne));
  EXPECT_EQ(at(0.5, none, 0), std::pair(1.0F, Provenance::kInferred));
  EXPECT_EQ(at(0.6, none, 0), std::pair(2.0F, Provenance::kInferred));
  EXPECT_EQ(at(0.6, none, 1), std::pair(0.0F, Provenance::kNone));
}

TEST(Baselines, HoldOutsideTheKeysAndSaySo) {
  Clip clip{.color_ns = {0, 10, 20, 30, 40}, .depth_ns = {10, 30}};
  clip.depth_m = [](int x, int, int64_t t) { return x == 0 ? 0.0F : (t == 10 ? 1.0F : 2.0F); };
  const MemorySource source = clip.Source();
  for (const std::string& name : BaselineNames()) {
    const auto results = Answer(name, source);
    EXPECT_EQ(results.at(0).depth_m(7, 7), 1.0F);
    EXPECT_EQ(results.at(40).depth_m(7, 7), 2.0F);
    for (int64_t t : {0, 40}) {
      EXPECT_EQ(results.at(t).provenance(7, 7), Provenance::kHeld) << name;
      EXPECT_EQ(results.at(t).provenance(0, 7), Provenance::kNone) << name;
    }
    for (int64_t t : {10, 30}) EXPECT_EQ(results.at(t).provenance(7, 7), Provenance::kMeasured) << name;
    EXPECT_EQ(results.at(10).depth_m(7, 7), 1.0F) << name;
    EXPECT_EQ(results.at(30).depth_m(7, 7), 2.0F) << name;
  }
}

// A method may leave a pixel open, but what it says of it must fit together.
TEST(Baselines, SayTheSameInDepthSigmaAndProvenance) {
  Clip clip{.color_ns = {0, 10, 20, 30}, .depth_ns = {0, 30}};
  clip.depth_m = [](int x, int y, int64_t) { return (x + y) % 7 < 3 ? 0.0F : 1.5F; };
  const MemorySource source = clip.Source();
  for (const std::string& name : BaselineNames()) {
    for (const auto& [time_ns, result] : Answer(name, source)) {
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          const bool filled = result.depth_m(x, y) > 0.0F;
          ASSERT_EQ(result.provenance(x, y) != Provenance::kNone, filled) << name << " " << time_ns;
          ASSERT_FLOAT_EQ(result.sigma_m(x, y), filled ? static_cast<float>(0.0015 + 0.0004 * 1.5 * 1.5) : 0.0F)
              << name;
        }
      }
    }
  }
}

// A textured plane slides 1.5 px a frame with a relief that slides along, and approaches by a known amount: away from
// the border, flow-warp must find depth where it came from. Holding it is off by the slide.
TEST(FlowWarp, FollowsASlidingTexture) {
  Clip clip{.color_ns = {0, 1, 2, 3, 4, 5, 6}, .depth_ns = {0, 6}};
  clip.grey = [](int x, int y, int64_t t) { return Texture(x - 1.5 * static_cast<double>(t), y); };
  clip.depth_m = [](int x, int, int64_t t) {
    return 2.0F + 0.01F * (static_cast<float>(x) - 1.5F * static_cast<float>(t)) - 0.005F * static_cast<float>(t);
  };
  const MemorySource source = clip.Source();
  const auto warped = Answer("flow-warp", source), held = Answer("hold", source);
  for (int64_t t = 1; t <= 5; ++t) {
    double warp_error = 0.0, hold_error = 0.0;
    for (int y = 16; y < kHeight - 16; ++y) {
      for (int x = 20; x < kWidth - 20; ++x) {
        warp_error = std::max<double>(warp_error, std::abs(warped.at(t).depth_m(x, y) - clip.depth_m(x, y, t)));
        hold_error = std::max<double>(hold_error, std::abs(held.at(t).depth_m(x, y) - clip.depth_m(x, y, t)));
        EXPECT_EQ(warped.at(t).provenance(x, y), Provenance::kBoth);
      }
    }
    // Nearest sampling is off by half a pixel of a relief of 1 cm a pixel at most; and the flow a little.
    EXPECT_LT(warp_error, 0.007) << t;
    EXPECT_GT(hold_error, 0.019 * static_cast<double>(t)) << t;
  }
}

// Where the sides disagree by more than 5 % nothing in between may come out: here 1 m and 3 m, so never 2 m.
TEST(FlowWarp, NeverMixesTwoSurfaces) {
  Clip clip{.color_ns = {0, 10, 20, 30}, .depth_ns = {0, 30}};
  clip.depth_m = [](int, int, int64_t t) { return t == 0 ? 1.0F : 3.0F; };
  const auto results = Answer("flow-warp", clip.Source());
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      EXPECT_EQ(results.at(10).depth_m(x, y), 1.0F);  // heavier because nearer in time
      EXPECT_EQ(results.at(20).depth_m(x, y), 3.0F);
    }
  }
}

// The picture slides 1 px a frame; both keys are seen by colour frames of other stamps, the first by the frame 2 ns
// earlier (of offset 0), the last by the frame 1 ns later (offset 4). Any other frame is off by 1 px, that is 1 cm.
TEST(FlowWarp, UsesTheColourFrameNearestToAKey) {
  Clip clip{.color_ns = {0, 10, 20, 30, 40}, .depth_ns = {2, 39}};
  clip.grey = [](int x, int y, int64_t t) { return Texture(x - 0.1 * static_cast<double>(t), y); };
  clip.depth_m = [](int x, int, int64_t t) { return 2.0F + 0.01F * static_cast<float>(t == 2 ? x : x - 4); };
  const auto results = Answer("flow-warp", clip.Source());
  for (int64_t t : {10, 20, 30})
    for (int y = 20; y < kHeight - 20; ++y)
      for (int x = 24; x < kWidth - 24; ++x)
        ASSERT_NEAR(results.at(t).depth_m(x, y), 2.0 + 0.01 * (x - 0.1 * static_cast<double>(t)), 0.006)
            << t << " " << x;
}

// The bits depend neither on threads nor on which part of an interval is asked for.
TEST(FlowWarp, GivesTheSameBitsHoweverItIsRun) {
  Clip clip{.color_ns = {0, 10, 20, 30, 40, 50}, .depth_ns = {0, 50}};
  clip.grey = [](int x, int y, int64_t t) {
    return Texture(x - 0.1 * static_cast<double>(t), y + 0.05 * static_cast<double>(t));
  };
  clip.depth_m = [](int x, int y, int64_t) {
    return 1.0F + 0.01F * static_cast<float>(x) + 0.02F * static_cast<float>(y % 9);
  };
  const MemorySource source = clip.Source();
  const auto once = Answer("flow-warp", source), threaded = Answer("flow-warp", source, 9);
  Interval part = PlanIntervals(source.sequence()).at(0);
  part.first_frame = 3;
  part.frame_count = 1;
  std::vector<DepthResult> alone;
  const auto baseline = MakeBaseline("flow-warp");
  ASSERT_TRUE((*baseline)
                  ->Run(source, ClipConstants{}, part, {},
                        [&](DepthResult result) {
                          alone.push_back(std::move(result));
                          return absl::OkStatus();
                        })
                  .ok());
  ASSERT_EQ(alone.size(), 1U);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      for (const auto& [time_ns, result] : once) ASSERT_EQ(result.depth_m(x, y), threaded.at(time_ns).depth_m(x, y));
      ASSERT_EQ(once.at(30).depth_m(x, y), alone[0].depth_m(x, y));
    }
  }
}

// An error of the sink and a stop end a run at once and are passed on.
TEST(Baselines, StopWhenAskedTo) {
  const Clip clip{.color_ns = {0, 10, 20, 30}, .depth_ns = {0, 10, 20}};
  const MemorySource source = clip.Source();
  for (const std::string& name : BaselineNames()) {
    const auto baseline = MakeBaseline(name);
    for (const Interval& interval : PlanIntervals(source.sequence())) {
      std::stop_source stop;
      stop.request_stop();
      const auto ignore = [](DepthResult) { return absl::OkStatus(); };
      EXPECT_EQ((*baseline)->Run(source, {}, interval, {.stop = stop.get_token()}, ignore).status().code(),
                absl::StatusCode::kCancelled);
      const auto full = [](DepthResult) { return absl::ResourceExhaustedError("disk full"); };
      EXPECT_EQ((*baseline)->Run(source, {}, interval, {}, full).status().message(), "disk full");
    }
  }
}

// A decoded frame of another size than the camera's must be refused, not read past its end.
TEST(Baselines, RefuseFramesOfAnotherSize) {
  Clip clip{.color_ns = {0, 10}, .depth_ns = {0, 20}};
  const MemorySource good = clip.Source();
  class Shrunk : public FrameSource {
   public:
    explicit Shrunk(const FrameSource& source) : source_(source) {}
    const Sequence& sequence() const override { return source_.sequence(); }
    absl::StatusOr<Image<Rgb8>> Color(int) const override { return Image<Rgb8>(8, 8); }
    absl::StatusOr<Image<float>> Depth(int index) const override {
      if (index == 0) return source_.Depth(index);
      return Image<float>(8, 8);
    }

   private:
    const FrameSource& source_;
  };
  const Shrunk source(good);
  const auto ignore = [](DepthResult) { return absl::OkStatus(); };
  for (const std::string& name : BaselineNames()) {
    const auto status =
        (*MakeBaseline(name))->Run(source, {}, PlanIntervals(good.sequence()).at(0), {}, ignore).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_THAT(status.message(), testing::HasSubstr("depth/20.png is 8 x 8, must be 96 x 80"));
  }
}

}  // namespace
}  // namespace depthtween
