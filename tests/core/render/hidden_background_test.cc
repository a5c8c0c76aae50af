// What lies behind an edge is known here by construction: the background is written down before the foreground is laid
// over it.
#include "core/render/hidden_background.h"

#include <cmath>
#include <cstdlib>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kFrameWidth = 96, kFrameHeight = 64;
constexpr Rgb8 kRed = {255, 0, 0};

// A red square at 1 m before a wall of greens and blues at 2 m; its outermost pixels are half wall, as a lens gives
// them, and belong to the wall by depth.
struct Stage {
  Image<Rgb8> wall{kFrameWidth, kFrameHeight}, color{kFrameWidth, kFrameHeight};
  Image<float> depth_m{kFrameWidth, kFrameHeight, 2.0F};
  RenderView View() const { return {color, depth_m}; }
};

bool OnSquare(int x, int y) { return x >= 30 && x < 60 && y >= 20 && y < 50; }

Stage MakeStage() {
  Stage stage;
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      const Rgb8 wall = {0, static_cast<uint8_t>(40 + x), static_cast<uint8_t>(200 - 2 * y)};
      stage.wall(x, y) = stage.color(x, y) = wall;
      if (OnSquare(x, y)) {
        stage.color(x, y) = kRed, stage.depth_m(x, y) = 1.0F;
      } else if (x >= 29 && x <= 60 && y >= 19 && y <= 50) {
        stage.color(x, y) = {128, static_cast<uint8_t>(wall.g / 2), static_cast<uint8_t>(wall.b / 2)};
      }
    }
  return stage;
}

TEST(HiddenBackground, ReachesAsFarAsAskedAndNoFarther) {
  const Stage stage = MakeStage();
  const HiddenBackground hidden = FindHiddenBackground(stage.View(), {}, {.reach_px = 6}, 1);
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      const bool near_edge = OnSquare(x, y) && (x < 36 || x >= 54 || y < 26 || y >= 44);
      const bool guard = !OnSquare(x, y) && x >= 29 && x <= 60 && y >= 19 && y <= 50;
      EXPECT_EQ(hidden.source(x, y), near_edge || guard ? kHiddenInferred : 0) << x << " " << y;
      EXPECT_NEAR(hidden.depth_m(x, y), near_edge || guard ? 2.0F : 0.0F, 1e-5F);
    }
}

// What another eye sees lies along rows; edges above and below are left alone, but for the mixed pixels beside them.
TEST(HiddenBackground, LooksOnTheSidesAskedFor) {
  const Stage stage = MakeStage();
  for (const EdgeSides sides : {EdgeSides::kLeft, EdgeSides::kRight, EdgeSides::kLeftAndRight}) {
    const HiddenBackground hidden = FindHiddenBackground(stage.View(), {}, {.sides = sides, .reach_px = 6}, 1);
    for (int y = 0; y < kFrameHeight; ++y)
      for (int x = 0; x < kFrameWidth; ++x) {
        if (!OnSquare(x, y)) continue;
        const bool wanted = (sides != EdgeSides::kRight && x < 36) || (sides != EdgeSides::kLeft && x >= 54);
        EXPECT_EQ(hidden.source(x, y), wanted ? kHiddenInferred : 0) << x << " " << y;
      }
  }
}

TEST(HiddenBackground, TakesNoColourOfTheForeground) {
  const Stage stage = MakeStage();
  const HiddenBackground hidden = FindHiddenBackground(stage.View(), {}, {.reach_px = 15}, 1);
  double error = 0;
  int pixels = 0;
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      if (hidden.source(x, y) == 0) continue;
      EXPECT_EQ(hidden.color(x, y).r, 0) << x << " " << y;
      error +=
          std::abs(hidden.color(x, y).g - stage.wall(x, y).g) + std::abs(hidden.color(x, y).b - stage.wall(x, y).b);
      ++pixels;
    }
  ASSERT_GT(pixels, 800);
  EXPECT_LT(error / pixels, 16.0);  // the wall changes by 30 and 60 across the square
}

// Between a near and a far layer stands a third: what is behind it must not become what is behind the near one.
TEST(HiddenBackground, KeepsLayersApart) {
  Stage stage;
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      const bool near = x >= 40 && x < 56, middle = y >= 32;
      stage.depth_m(x, y) = near ? 1.0F : middle ? 2.0F : 4.0F;
      stage.color(x, y) = near ? Rgb8{255, 0, 0} : middle ? Rgb8{0, 255, 0} : Rgb8{0, 0, 255};
    }
  const HiddenBackground hidden = FindHiddenBackground(stage.View(), {}, {.reach_px = 8}, 2);
  for (int x = 40; x < 56; ++x) {
    EXPECT_EQ(hidden.color(x, 60), (Rgb8{0, 255, 0}));
    EXPECT_EQ(hidden.color(x, 4), (Rgb8{0, 0, 255}));
  }
  EXPECT_EQ(hidden.color(10, 33), (Rgb8{0, 0, 255})) << "behind the middle layer's upper edge";
}

// In the other frame the square has moved away by (-24, 0) and the whole wall by (2, 1): what is hidden is found there,
// bit for bit, where that frame's image holds it. Motion near the square is dragged along with it, as measured motion
// is.
TEST(HiddenBackground, TakesFromAnotherFrameWhatIsSeenThere) {
  const Stage stage = MakeStage();
  Image<Rgb8> other_color(kFrameWidth, kFrameHeight);
  Image<float> other_depth_m(kFrameWidth, kFrameHeight, 2.0F);
  Image<Flow2> motion(kFrameWidth, kFrameHeight, Flow2{2, 1});
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      other_color(x, y) = stage.wall.view().Clamped(x - 2, y - 1);
      if (OnSquare(x + 24, y)) other_color(x, y) = kRed, other_depth_m(x, y) = 1.0F;
      if (OnSquare(x - 5, y) || OnSquare(x + 5, y)) motion(x, y) = {-24, 0};
    }
  const NeighborFrame other{{other_color, other_depth_m}, motion};
  const HiddenBackground hidden = FindHiddenBackground(stage.View(), {other}, {.reach_px = 15}, 2);
  int seen = 0;
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      EXPECT_NE(hidden.color(x, y), kRed);
      if (!OnSquare(x, y) || hidden.source(x, y) == 0) continue;
      // There the wall must lie a pixel clear of the square: its right edge is at 36.
      const bool clear = x + 2 - 1 >= 36 || y + 1 - 1 >= 50;
      EXPECT_EQ(hidden.source(x, y), clear ? kHiddenSeen : kHiddenInferred) << x << " " << y;
      if (!clear) continue;
      EXPECT_EQ(hidden.color(x, y), stage.wall(x, y)) << x << " " << y;
      EXPECT_EQ(hidden.depth_m(x, y), 2.0F);
      ++seen;
    }
  EXPECT_GT(seen, 500);
}

// A frame that shows another layer where the background should be shows nothing of it.
TEST(HiddenBackground, DoesNotTakeAnotherLayer) {
  const Stage stage = MakeStage();
  const Image<Flow2> still(kFrameWidth, kFrameHeight);
  const HiddenBackground hidden = FindHiddenBackground(stage.View(), {{stage.View(), still}}, {}, 1);
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) EXPECT_NE(hidden.source(x, y), kHiddenSeen);
}

TEST(HiddenBackground, DoesNotDependOnThreads) {
  const Stage stage = MakeStage();
  const HiddenBackground one = FindHiddenBackground(stage.View(), {}, {}, 1);
  const HiddenBackground three = FindHiddenBackground(stage.View(), {}, {}, 3);
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) {
      EXPECT_EQ(one.color(x, y), three.color(x, y));
      EXPECT_EQ(one.depth_m(x, y), three.depth_m(x, y));
    }
}

TEST(HiddenBackground, FlatAndUnknownDepthHideNothing) {
  Stage stage = MakeStage();
  stage.depth_m.Fill(2.0F);
  for (int x = 0; x < kFrameWidth; ++x) stage.depth_m(x, 10) = 0.0F;
  const HiddenBackground hidden = FindHiddenBackground(stage.View(), {}, {}, 1);
  for (int y = 0; y < kFrameHeight; ++y)
    for (int x = 0; x < kFrameWidth; ++x) EXPECT_EQ(hidden.source(x, y), 0);
}

TEST(HiddenBackgroundOptions, NameTheField) {
  EXPECT_TRUE(HiddenBackgroundOptions{}.Validate().ok());
  EXPECT_THAT(HiddenBackgroundOptions{.reach_px = 0}.Validate().message(), testing::HasSubstr("reach_px = 0"));
  EXPECT_THAT(HiddenBackgroundOptions{.guard_px = 9}.Validate().message(), testing::HasSubstr("guard_px = 9"));
  EXPECT_THAT(HiddenBackgroundOptions{.layer_gap = 0}.Validate().message(), testing::HasSubstr("layer_gap = 0"));
}

}  // namespace
}  // namespace depthtween
