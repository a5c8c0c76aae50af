// Causal mode on clips whose depth is known at every time, drawn by formula or rendered.
#include "core/upsample/causal.h"

#include <cmath>
#include <cstring>
#include <random>

#include "core/baselines/baselines.h"
#include "gtest/gtest.h"
#include "tests/core/upsample/drawn_clip.h"
#include "tests/core/upsample/rendered_clip.h"

namespace depthtween {
namespace {

constexpr double kFocal = 90, kMiddleX = 47.5, kMiddleY = 35.5;

std::vector<DepthResult> RunCausal(const FrameSource& source, const ClipConstants& constants = {}, int threads = 2) {
  std::vector<DepthResult> results;
  size_t planned = 0;
  const auto pipeline = MakeCausalUpsampler();
  for (const Interval& interval : PlanIntervals(source.sequence())) {
    const auto summary = pipeline->Run(source, constants, interval, {.threads = threads}, [&](DepthResult result) {
      results.push_back(std::move(result));
      return absl::OkStatus();
    });
    EXPECT_TRUE(summary.ok()) << summary.status();
    EXPECT_EQ(summary->frames, interval.frame_count);
    planned += static_cast<size_t>(interval.frame_count);
  }
  EXPECT_GT(planned, 0U);
  EXPECT_EQ(results.size(), planned);
  return results;
}

Sequence Clip(int color_frames, double color_fps, const std::vector<double>& depth_s) {
  Sequence s{.camera = {.width = kWidth, .height = kHeight, .fx = kFocal, .fy = kFocal, .cx = kMiddleX, .cy = kMiddleY},
             .depth_scale = 5000};
  for (int i = 0; i < color_frames; ++i)
    s.color.push_back({std::llround(i / color_fps * 1e9), "rgb/" + std::to_string(i) + ".png"});
  for (const double t : depth_s)
    s.depth.push_back({std::llround(t * 1e9), "depth/" + std::to_string(s.depth.size()) + ".png"});
  return s;
}

// A textured wall that comes nearer at a constant speed, and a square before it that crosses it.
struct Approach {
  double wall_m = 2.5, wall_mps = 0;     // at time 0, and how it changes
  double square_m = 1.0, square_px = 0;  // its depth, and how many pixels a second it moves; 0: no square
  bool OnSquare(int x, int y, double t) const {
    const double left = 30 + square_px * t;
    return square_px != 0 && x >= left && x < left + 28 && y >= 22 && y < 52;
  }
  Image<Rgb8> Color(double t) const {
    Image<Rgb8> image(kWidth, kHeight);
    const double z = wall_m + wall_mps * t;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const Rgb8 square = Texture(2.1 * (x - square_px * t) + 400, 1.7 * y - 90);
        image(x, y) = OnSquare(x, y, t) ? Rgb8{square.b, square.r, 30}
                                        : Texture((x - kMiddleX) * z / 2.5, (y - kMiddleY) * z / 2.5);
      }
    return image;
  }
  Image<float> Depth(double t) const {
    Image<float> depth(kWidth, kHeight, static_cast<float>(wall_m + wall_mps * t));
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if (OnSquare(x, y, t)) depth(x, y) = static_cast<float>(square_m);
    return depth;
  }
  MemorySource Source(int color_frames, double color_fps, const std::vector<double>& depth_s) const {
    std::vector<Image<Rgb8>> color;
    std::vector<Image<float>> depth;
    for (int i = 0; i < color_frames; ++i) color.push_back(Color(i / color_fps));
    for (const double t : depth_s) depth.push_back(Depth(t));
    return MemorySource(Clip(color_frames, color_fps, depth_s), std::move(color), std::move(depth));
  }
};

// What a source shows until a frame, and noise from then on.
class Tampered : public FrameSource {
 public:
  Tampered(const FrameSource& source, int last_frame) : source_(source), last_frame_(last_frame) {}
  const Sequence& sequence() const override { return source_.sequence(); }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override {
    absl::StatusOr<Image<Rgb8>> image = source_.Color(index);
    std::mt19937 random(static_cast<unsigned>(index));
    if (index > last_frame_)
      for (size_t i = 0; i < image->pixel_count(); ++i) image->data()[i] = {static_cast<uint8_t>(random()), 90, 7};
    return image;
  }
  absl::StatusOr<Image<float>> Depth(int index) const override {
    absl::StatusOr<Image<float>> image = source_.Depth(index);
    std::mt19937 random(static_cast<unsigned>(index));
    if (sequence().depth[index].time_ns > sequence().color[last_frame_].time_ns)
      for (size_t i = 0; i < image->pixel_count(); ++i)
        image->data()[i] = 1 + static_cast<float>(random() % 4096) / 1024;
    return image;
  }

 private:
  const FrameSource& source_;
  const int last_frame_;
};

// The promise itself: whatever comes later is replaced by noise, and what was answered before stays, to the bit. Depth
// stamps that fall between colour frames included, and the noise of the sensor as the first key tells it.
TEST(Causal, NothingLaterChangesAFrame) {
  const RenderedClip clip({.scene = "kick", .frames = 22, .depth_phase_s = 0.0105, .width = 96, .height = 80});
  const auto constants = EstimateClipConstants(clip.source(), /*noise_of_first_key=*/true);
  ASSERT_TRUE(constants.ok());
  const auto results = RunCausal(clip.source(), *constants);
  ASSERT_EQ(results.size(), 22U);
  for (const int last : {5, 11, 18}) {
    const Tampered tampered(clip.source(), last);
    const auto tampered_constants = EstimateClipConstants(tampered, /*noise_of_first_key=*/true);
    ASSERT_TRUE(tampered_constants.ok());
    const auto until = RunCausal(tampered, *tampered_constants);
    for (int i = 0; i <= last; ++i) EXPECT_TRUE(SameBits(until[i], results[i])) << i << " of " << last;
    EXPECT_FALSE(SameBits(until[21], results[21]));
  }
}

TEST(Causal, GivesTheSameBitsForAnyThreads) {
  const MemorySource source = Approach{.square_px = 250}.Source(7, 100, {0, 0.03});
  const auto one = RunCausal(source, {}, 1), three = RunCausal(source, {}, 3);
  for (size_t i = 0; i < one.size(); ++i) EXPECT_TRUE(SameBits(one[i], three[i])) << i;
}

// Truth is the wall's depth. Between keys 33 ms apart it comes 33 mm nearer: one that only moves in the image would
// end that far off.
TEST(Causal, SurfacesGoOnComing) {
  const Approach scene{.wall_mps = -1.0};
  const auto results = RunCausal(scene.Source(12, 120, {0, 4 / 120.0, 8 / 120.0}));
  for (int i = 5; i < 12; ++i) EXPECT_GT(ShareWithin(results[i].depth_m, scene.Depth(i / 120.0), 0.006F), 0.95) << i;
  EXPECT_LT(ShareWithin(results[3].depth_m, scene.Depth(3 / 120.0), 0.006F), 0.05) << "of one key nothing can be told";
}

// The square uncovers wall that the key never saw: it must be wall, and marked as a guess.
TEST(Causal, WhatWasHiddenIsInferredFromBehind) {
  const Approach scene{.square_px = 300};
  const auto results = RunCausal(scene.Source(6, 100, {0, 0.04}));
  const Image<float> truth = scene.Depth(0.03);
  EXPECT_GT(ShareWithin(results[3].depth_m, truth, 0.02F), 0.97);
  int uncovered = 0, inferred = 0;
  for (int y = 24; y < 50; ++y)
    for (int x = 32; x < 37; ++x) {  // covered at 30..57 at the key's time, from 39 on now
      ++uncovered;
      inferred += results[3].provenance(x, y) == Provenance::kInferred;
    }
  EXPECT_GT(inferred, uncovered / 2);
}

// Before the first key there is nothing to know; after the last one frames are computed, not held.
TEST(Causal, BeginsWithTheFirstKeyAndGoesOnAfterTheLast) {
  const Approach scene{.square_px = 200};
  const auto results = RunCausal(scene.Source(14, 100, {0.02, 0.04}));
  EXPECT_EQ(results[1].depth_m(10, 10), 0.0F);
  EXPECT_EQ(results[1].provenance(10, 10), Provenance::kNone);
  EXPECT_EQ(results[2].provenance(10, 10), Provenance::kMeasured);
  EXPECT_EQ(results[4].provenance(10, 10), Provenance::kMeasured) << "the frame of the last key is that key's";
  EXPECT_EQ(results[9].provenance(10, 10), Provenance::kOne);
  EXPECT_GT(ShareWithin(results[9].depth_m, scene.Depth(0.09), 0.02F), 0.95);
}

// On rendered scenes with a sensor's noise, whose truth is exact.
TEST(Causal, BeatsHoldOnRenderedScenes) {
  for (const char* scene : {"kick", "bounce"}) {
    const RenderedClip clip({.scene = scene, .frames = 17, .width = 192, .height = 160});
    const auto constants = EstimateClipConstants(clip.source(), /*noise_of_first_key=*/true);
    ASSERT_TRUE(constants.ok());
    const auto hold = MakeBaseline("hold");
    ASSERT_TRUE(hold.ok());
    const double causal_rmse = RmseM(*MakeCausalUpsampler(), clip, *constants, Unfilled::kIsLeftOut);
    const double hold_rmse = RmseM(**hold, clip, *constants, Unfilled::kIsLeftOut);
    RecordProperty(std::string(scene) + "_ratio", std::to_string(causal_rmse / hold_rmse));
    // 0.65 and 0.70; compilers' ways of rounding move the second by a hundredth.
    EXPECT_LT(causal_rmse, 0.75 * hold_rmse) << scene;
  }
}

}  // namespace
}  // namespace depthtween
