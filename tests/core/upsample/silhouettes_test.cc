// Silhouettes of a box whose edges are known; depth was moved off them on purpose.
#include "core/upsample/silhouettes.h"

#include <cmath>
#include <cstdlib>
#include <random>
#include <vector>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kClipWidth = 72, kClipHeight = 48, kFrames = 9, kStepPx = 2;
constexpr float kNearM = 1.5F, kFarM = 3.0F;

// A textured box moves `kStepPx` a frame to the right before a textured wall that stands still. Everything is known.
class MovingBox {
 public:
  MovingBox() : wall_(kClipWidth, kClipHeight), box_(kClipWidth, kClipHeight) {
    std::mt19937 random(5);
    for (int y = 0; y < kClipHeight; ++y)
      for (int x = 0; x < kClipWidth; ++x) {
        const auto dark = [&] { return static_cast<uint8_t>(40 + random() % 60); };
        const auto light = [&] { return static_cast<uint8_t>(120 + random() % 60); };
        wall_(x, y) = {dark(), dark(), dark()};
        box_(x, y) = {light(), light(), light()};
      }
    for (int k = 0; k < kFrames; ++k) {
      color.emplace_back(kClipWidth, kClipHeight);
      for (int y = 0; y < kClipHeight; ++y)
        for (int x = 0; x < kClipWidth; ++x) color[k](x, y) = InBox(k, x, y) ? box_(x - kStepPx * k, y) : wall_(x, y);
    }
  }

  static bool InBox(int frame, int x, int y) {
    return x >= 16 + kStepPx * frame && x < 36 + kStepPx * frame && y >= 12 && y < 36;
  }
  // Depth of a frame, with the box `wider` pixels too wide on its right.
  static Image<float> Depth(int frame, int wider) {
    Image<float> depth(kClipWidth, kClipHeight);
    for (int y = 0; y < kClipHeight; ++y)
      for (int x = 0; x < kClipWidth; ++x)
        depth(x, y) = InBox(frame, x, y) || InBox(frame, x - wider, y) ? kNearM : kFarM;
    return depth;
  }

  std::vector<Image<Rgb8>> color;

 private:
  Image<Rgb8> wall_, box_;
};

// What LookAtSilhouettes needs to know of one frame of the box, where depth is `depth`.
struct Situation {
  Situation(const MovingBox& scene, int target, const Image<float>& depth)
      : fused{depth.Clone(), Image<float>(kClipWidth, kClipHeight), Image<float>(kClipWidth, kClipHeight, 1.0F),
              Image<Provenance>(kClipWidth, kClipHeight, Provenance::kOne), Image<uint8_t>(kClipWidth, kClipHeight)} {
    for (int s = 0; s < 2; ++s) {
      const int frame = s == 0 ? 0 : kFrames - 1;
      keys[s].depth_m = MovingBox::Depth(frame, 0);
      keys[s].distance = Image<float>(kClipWidth, kClipHeight);
      choice.sides[s] = {Image<Flow2>(kClipWidth, kClipHeight), Image<float>(kClipWidth, kClipHeight), depth.Clone()};
      for (int y = 0; y < kClipHeight; ++y)
        for (int x = 0; x < kClipWidth; ++x)
          if (depth(x, y) == kNearM) choice.sides[s].motion(x, y) = {static_cast<float>(kStepPx * (frame - target)), 0};
    }
    input = {.target = target, .fused = &fused, .choice = &choice, .keys = {&keys[0], &keys[1]}, .noise = {}};
    for (int k = 0; k < kFrames; ++k)
      input.window.push_back({.tau = static_cast<float>(k) / (kFrames - 1), .color = scene.color[k]});
    input.window[target].depth_m = fused.depth_m;
  }

  Image<float> Settled() const {
    Image<float> depth = fused.depth_m.Clone();
    SettleSilhouettes(LookAtSilhouettes(input), kSilhouetteWeights[0], depth);
    return depth;
  }

  Fused fused;
  Choice choice;
  Key keys[2];
  SilhouetteInput input;
};

int Wrong(const Image<float>& depth, int frame) {
  const Image<float> truth = MovingBox::Depth(frame, 0);
  int wrong = 0;
  for (size_t p = 0; p < depth.pixel_count(); ++p) wrong += depth.data()[p] != truth.data()[p];
  return wrong;
}

// By construction the box's right side is one pixel too wide, 24 pixels in all, and colours, keys and motion say so.
TEST(Silhouettes, MovesAnEdgeToWhereColorsAndKeysSeeIt) {
  const MovingBox scene;
  const Image<float> depth = MovingBox::Depth(4, 1);
  ASSERT_EQ(Wrong(depth, 4), 24);
  EXPECT_LE(Wrong(Situation(scene, 4, depth).Settled(), 4), 3);
}

// A map that is right by construction stays right, at the ends of the interval as well as within.
TEST(Silhouettes, LeavesARightEdgeAlone) {
  const MovingBox scene;
  for (const int frame : {0, 4, kFrames - 1})
    EXPECT_LE(Wrong(Situation(scene, frame, MovingBox::Depth(frame, 0)).Settled(), frame), 3) << "frame " << frame;
}

// Only pixels beside a jump are looked at, each with the two depths that meet there; unknown depth is no surface.
TEST(Silhouettes, LooksOnlyBesideJumps) {
  const MovingBox scene;
  Image<float> depth = MovingBox::Depth(4, 0);
  for (int x = 0; x < kClipWidth; ++x) depth(x, 0) = 0;
  const Situation situation(scene, 4, depth);
  const std::vector<SilhouettePixel> pixels = LookAtSilhouettes(situation.input);
  EXPECT_EQ(pixels.size(), 2U * (20 + 24) - 4 + 2U * (20 + 24));  // inner ring, and outer ring without its corners
  for (const SilhouettePixel& pixel : pixels) {
    EXPECT_EQ(pixel.near_m, kNearM);
    EXPECT_EQ(pixel.far_m, kFarM);
    EXPECT_EQ(pixel.is_near, depth(pixel.x, pixel.y) == kNearM);
    for (const float evidence : pixel.evidence) EXPECT_TRUE(std::isfinite(evidence));
  }
}

// A later pass looks again at the pixels within two of a change, and at no others.
TEST(Silhouettes, LooksAgainOnlyNearChanges) {
  const MovingBox scene;
  Situation situation(scene, 4, MovingBox::Depth(4, 0));
  const size_t all = LookAtSilhouettes(situation.input).size();
  Image<uint8_t> changed(kClipWidth, kClipHeight);
  situation.input.changed = changed;
  EXPECT_TRUE(LookAtSilhouettes(situation.input).empty());
  changed(24, 20) = 1;  // the left side of the box
  const std::vector<SilhouettePixel> pixels = LookAtSilhouettes(situation.input);
  EXPECT_EQ(pixels.size(), 10U);  // five rows, both sides of the jump
  EXPECT_LT(pixels.size(), all);
  for (const SilhouettePixel& pixel : pixels) {
    EXPECT_LE(std::abs(pixel.x - 24), 2);
    EXPECT_LE(std::abs(pixel.y - 20), 2);
  }
}

// Where two frames bear one time, as stamps clamped to a key's do, nothing is divided by zero.
TEST(Silhouettes, StandsFramesOfOneTime) {
  const MovingBox scene;
  Situation situation(scene, 7, MovingBox::Depth(7, 0));
  situation.input.window[7].tau = 1;
  const Image<float> later = MovingBox::Depth(8, 0);
  situation.input.window[8].depth_m = later;
  for (const SilhouettePixel& pixel : LookAtSilhouettes(situation.input))
    for (const float evidence : pixel.evidence) EXPECT_TRUE(std::isfinite(evidence));
}

}  // namespace
}  // namespace depthtween
