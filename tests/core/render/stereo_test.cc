// Stereo from depth. Truth: the arithmetic of parallel cameras (a plane moves by its disparity, what is nearer than the
// screen lies further right in the left eye), and pictures whose hidden parts are written down before they are covered.
#include "core/render/stereo.h"

#include <cmath>
#include <cstdlib>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kWidth = 128, kHeight = 64;

Camera TestCamera() {
  Camera camera;
  camera.width = kWidth, camera.height = kHeight;
  camera.fx = camera.fy = 100.0, camera.cx = 63.5, camera.cy = 31.5;
  return camera;
}

// Smooth, and different in every column, row and channel.
Rgb8 Texture(double x, double y) {
  const auto wave = [](double phase) { return static_cast<uint8_t>(std::lround(128 + 100 * std::sin(phase))); };
  return {wave(0.11 * x + 0.05 * y), wave(0.07 * x - 0.08 * y + 1), wave(0.05 * x + 2)};
}

struct Frame {
  Image<Rgb8> color{kWidth, kHeight};
  Image<float> depth_m{kWidth, kHeight};
  RenderView View() const { return {color, depth_m}; }
};

// A textured plane at `depth_m`.
Frame Plane(float depth_m) {
  Frame frame;
  frame.depth_m.Fill(depth_m);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) frame.color(x, y) = Texture(x, y);
  return frame;
}

// A wall at 4 m of greens and blues, without any red, and a red box at 2 m before it.
Frame BoxBeforeWall() {
  Frame frame = Plane(4.0F);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      frame.color(x, y).r = 0;
      if (x >= 50 && x < 80 && y >= 16 && y < 48) frame.color(x, y) = {255, 0, 0}, frame.depth_m(x, y) = 2.0F;
    }
  return frame;
}

// f B = 40 px m and the screen at infinity unless told: d = 40 / z.
StereoGeometry Geometry(double baseline_m = 0.4, double convergence_m = std::numeric_limits<double>::infinity()) {
  StereoGeometry geometry;
  geometry.focal_px = 100.0, geometry.baseline_m = baseline_m, geometry.convergence_m = convergence_m;
  geometry.background.reach_px = 24;
  return geometry;
}

StereoPair Render(const Frame& frame, const StereoGeometry& geometry, const StereoOptions& options = {}) {
  return RenderStereo(frame.View(), FindHiddenBackground(frame.View(), {}, geometry.background, 1), geometry, options,
                      1);
}

Frame Mirrored(const Frame& frame) {
  Frame out;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      out.color(x, y) = frame.color(kWidth - 1 - x, y);
      out.depth_m(x, y) = frame.depth_m(kWidth - 1 - x, y);
    }
  return out;
}

int Difference(Rgb8 a, Rgb8 b) { return std::max({std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)}); }

TEST(Stereo, NoBaselineIsTheIdentity) {
  Frame frame = BoxBeforeWall();
  for (int y = 10; y < 50; ++y) frame.color(49, y) = {120, 30, 60}, frame.depth_m(90, y) = 0.0F;
  for (const MadeEye made : {MadeEye::kLeft, MadeEye::kRight, MadeEye::kBoth}) {
    const StereoPair pair = Render(frame, Geometry(0.0), {.made = made});
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        EXPECT_EQ(pair.left(x, y), frame.color(x, y)) << x << " " << y;
        EXPECT_EQ(pair.right(x, y), frame.color(x, y)) << x << " " << y;
      }
  }
}

// x_left - x_right = f B (1/z - 1/z_c): whole pixels here, so the colours are the same bits.
TEST(Stereo, PlaneShiftsByItsDisparity) {
  const Frame frame = Plane(4.0F);
  struct Case {
    double convergence_m;
    int disparity_px;
  };
  for (const auto& [convergence_m, disparity_px] :
       {Case{std::numeric_limits<double>::infinity(), 10}, Case{8.0, 5}, Case{4.0, 0}, Case{2.0, -10}}) {
    const StereoGeometry geometry = Geometry(0.4, convergence_m);
    EXPECT_NEAR(geometry.DisparityPx(4.0), disparity_px, 1e-9);
    const Image<Rgb8> left = Render(frame, geometry).left;
    const Image<Rgb8> right = Render(frame, geometry, {.made = MadeEye::kRight}).right;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 20; x < kWidth - 20; ++x) {
        EXPECT_LE(Difference(left(x + disparity_px, y), frame.color(x, y)), 0) << x << " " << y;
        EXPECT_LE(Difference(right(x - disparity_px, y), frame.color(x, y)), 0) << x << " " << y;
      }
  }
}

// A quarter of a pixel, seen in a ramp of four codes a pixel.
TEST(Stereo, PlaneShiftsByPartsOfAPixel) {
  Frame frame = Plane(4.0F);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < 60; ++x) frame.color(x, y) = {static_cast<uint8_t>(4 * x), 0, 0};
  const Image<Rgb8> left = Render(frame, Geometry(0.01)).left;
  for (int x = 2; x < 50; ++x) EXPECT_EQ(left(x, 5).r, 4 * x - 1);
}

// Symmetric eyes share the disparity.
TEST(Stereo, BothEyesMoveHalfWay) {
  const Frame frame = Plane(4.0F);
  const StereoPair pair = Render(frame, Geometry(), {.made = MadeEye::kBoth});
  for (int x = 20; x < kWidth - 20; ++x) {
    EXPECT_EQ(pair.left(x + 5, 9), frame.color(x, 9));
    EXPECT_EQ(pair.right(x - 5, 9), frame.color(x, 9));
  }
}

TEST(Stereo, RecordedEyeKeepsItsBits) {
  const Frame frame = BoxBeforeWall();
  const StereoPair left_made = Render(frame, Geometry()),
                   right_made = Render(frame, Geometry(), {.made = MadeEye::kRight});
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      EXPECT_EQ(left_made.right(x, y), frame.color(x, y));
      EXPECT_EQ(right_made.left(x, y), frame.color(x, y));
    }
}

// The right eye of a scene is the mirror image of the left eye of the mirrored scene.
TEST(Stereo, EyesSwapInTheMirror) {
  const Frame frame = BoxBeforeWall();
  const Image<Rgb8> right = Render(frame, Geometry(0.33, 3.0), {.made = MadeEye::kRight}).right;
  const Image<Rgb8> left = Render(Mirrored(frame), Geometry(0.33, 3.0)).left;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) EXPECT_LE(Difference(right(x, y), left(kWidth - 1 - x, y)), 1) << x << " " << y;
}

// The box moves 20 px right in the left eye and the wall 10, so the wall opens left of the box: there, everything must
// be wall, and the box must cover the wall on its right.
TEST(Stereo, HolesHoldBackgroundOnly) {
  const Frame frame = BoxBeforeWall();
  const StereoGeometry geometry = Geometry();
  const HiddenBackground hidden = FindHiddenBackground(frame.View(), {}, geometry.background, 1);
  Image<uint8_t> missing;
  const Image<Rgb8> left = RenderEye(frame.View(), hidden, geometry, -1.0, 1, &missing);
  for (int y = 16; y < 48; ++y)
    for (int x = 10; x < kWidth; ++x) {
      const bool box = x >= 70 && x < 100;
      EXPECT_EQ(left(x, y).r, box ? 255 : 0) << x << " " << y;
      EXPECT_EQ(missing(x, y) != 0, x >= 60 && x < 70) << x << " " << y;
      if (x < 60) {
        EXPECT_EQ(left(x, y), frame.color(x - 10, y)) << x << " " << y;
      }
    }
}

// A pixel that is half box and half wall, but wall by its depth, leaves no reddish outline where the wall stays, and
// goes on softening the box where that has gone.
TEST(Stereo, MixedPixelsMoveWithTheForeground) {
  Frame frame;
  frame.depth_m.Fill(4.0F);
  frame.color.Fill({0, 100, 0});
  for (int y = 16; y < 48; ++y) {
    for (int x = 50; x < 80; ++x) frame.color(x, y) = {200, 0, 0}, frame.depth_m(x, y) = 2.0F;
    frame.color(49, y) = frame.color(80, y) = {100, 50, 0};
  }
  const Image<Rgb8> left = Render(frame, Geometry()).left;
  for (int y = 20; y < 44; ++y) {
    for (int x = 10; x < 69; ++x) EXPECT_LE(Difference(left(x, y), {0, 100, 0}), 1) << x << " " << y;
    EXPECT_LE(Difference(left(69, y), {100, 50, 0}), 1);
    EXPECT_EQ(left(70, y), (Rgb8{200, 0, 0}));
    EXPECT_EQ(left(99, y), (Rgb8{200, 0, 0}));
    EXPECT_LE(Difference(left(100, y), {100, 50, 0}), 1);
    for (int x = 101; x < kWidth; ++x) EXPECT_LE(Difference(left(x, y), {0, 100, 0}), 1) << x << " " << y;
  }
}

TEST(Stereo, UnknownDepthGoesWithTheFartherSide) {
  Frame frame = BoxBeforeWall();
  for (int y = 16; y < 48; ++y)
    for (int x = 80; x < 84; ++x) frame.depth_m(x, y) = 0.0F;
  Frame known = BoxBeforeWall();
  const StereoPair with_hole = Render(frame, Geometry()), without = Render(known, Geometry());
  for (int x = 0; x < kWidth; ++x) EXPECT_LE(Difference(with_hole.left(x, 30), without.left(x, 30)), 1) << x;
  Frame unknown = Plane(0.0F);  // nothing known: everything lies on the screen
  const StereoPair flat = Render(unknown, Geometry(0.4, 3.0));
  for (int x = 0; x < kWidth; ++x) EXPECT_EQ(flat.left(x, 30), unknown.color(x, 30));
}

TEST(Stereo, FloatingWindowBlackensOuterBorders) {
  StereoGeometry geometry = Geometry();
  geometry.window_px = 7;
  const StereoPair pair = Render(Plane(4.0F), geometry);
  for (int y = 0; y < kHeight; ++y) {
    EXPECT_EQ(pair.left(6, y), Rgb8{});
    EXPECT_FALSE(pair.left(7, y) == Rgb8{});
    EXPECT_EQ(pair.right(kWidth - 7, y), Rgb8{});
    EXPECT_FALSE(pair.right(kWidth - 8, y) == Rgb8{});
  }
}

TEST(Stereo, DoesNotDependOnThreads) {
  const Frame frame = BoxBeforeWall();
  const StereoGeometry geometry = Geometry();
  const HiddenBackground hidden = FindHiddenBackground(frame.View(), {}, geometry.background, 1);
  const StereoPair one = RenderStereo(frame.View(), hidden, geometry, {}, 1);
  const StereoPair three = RenderStereo(frame.View(), hidden, geometry, {}, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) EXPECT_EQ(one.left(x, y), three.left(x, y));
}

// Nothing to prove but that no pixel outside is touched.
TEST(Stereo, ImagesOfFewPixels) {
  for (int width = 1; width <= 5; ++width)
    for (int height = 1; height <= 3; ++height) {
      const Image<Rgb8> color(width, height, Rgb8{9, 9, 9});
      Image<float> depth_m(width, height, 1.0F);
      for (int x = 0; x < width; x += 2) depth_m(x, height / 2) = 4.0F;
      const RenderView view{color, depth_m};
      for (const double baseline_m : {0.01, 0.5}) {
        const StereoGeometry geometry = Geometry(baseline_m, 2.0);
        const HiddenBackground hidden = FindHiddenBackground(view, {}, geometry.background, 1);
        EXPECT_EQ(RenderStereo(view, hidden, geometry, {.made = MadeEye::kBoth}, 1).left.width(), width);
      }
    }
}

// ---- The numbers of a clip

TEST(ResolveStereo, TakesWhatIsGiven) {
  const auto geometry =
      ResolveStereo(TestCamera(), {.baseline_m = 0.065, .convergence_m = 2.5, .floating_window = false}, {2, 6, 3});
  ASSERT_TRUE(geometry.ok());
  EXPECT_EQ(geometry->baseline_m, 0.065);
  EXPECT_EQ(geometry->convergence_m, 2.5);
  EXPECT_EQ(geometry->focal_px, 100.0);
  EXPECT_EQ(geometry->window_px, 0);
  EXPECT_TRUE(geometry->background.Validate().ok());
}

// The definition of divergence: disparity between near and far, percent of the width.
TEST(ResolveStereo, StretchesTheClipOverTheDivergence) {
  const auto geometry = ResolveStereo(TestCamera(), {.divergence_percent = 3.0}, {1.5, 9.0, 4.0});
  ASSERT_TRUE(geometry.ok());
  EXPECT_NEAR(geometry->DisparityPx(1.5) - geometry->DisparityPx(9.0), 0.03 * kWidth, 1e-9);
}

TEST(ResolveStereo, PutsTheMedianOnTheScreenUnlessTooMuchStandsBeforeIt) {
  const auto near_median = ResolveStereo(TestCamera(), {}, {2.0, 8.0, 2.2});
  ASSERT_TRUE(near_median.ok());
  EXPECT_NEAR(near_median->convergence_m, 2.2, 1e-9);
  const auto far_median = ResolveStereo(TestCamera(), {}, {2.0, 8.0, 7.0});
  ASSERT_TRUE(far_median.ok());
  EXPECT_NEAR(far_median->DisparityPx(2.0), -far_median->DisparityPx(8.0) / 2, 1e-9) << "a third in front";
  EXPECT_EQ(far_median->window_px, static_cast<int>(std::ceil(far_median->DisparityPx(2.0))));
}

TEST(ResolveStereo, FlatClipsStayFinite) {
  const auto geometry = ResolveStereo(TestCamera(), {}, {3.0, 3.0, 3.0});
  ASSERT_TRUE(geometry.ok());
  EXPECT_LT(geometry->baseline_m, 1.0);
  EXPECT_NEAR(geometry->DisparityPx(3.0), 0.0, 1e-9);
}

TEST(ResolveStereo, NamesTheField) {
  const auto message = [](const StereoOptions& options, const DepthDistribution& depth = {2, 6, 3}) {
    const auto geometry = ResolveStereo(TestCamera(), options, depth);
    EXPECT_EQ(geometry.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(geometry.status().message());
  };
  EXPECT_THAT(message({.baseline_m = -0.1}), testing::HasSubstr("baseline_m = -0.1"));
  EXPECT_THAT(message({.baseline_m = 1e9}), testing::HasSubstr("baseline_m = 1e+09, must be 0 to 100 metres"));
  EXPECT_FALSE(StereoOptions{.baseline_m = 1e9}.Validate().ok()) << "it needs no clip to be wrong";
  EXPECT_THAT(message({.baseline_m = 20.0}), testing::HasSubstr("baseline_m = 20"));
  EXPECT_THAT(message({.divergence_percent = 0.0}), testing::HasSubstr("divergence_percent = 0"));
  EXPECT_THAT(message({.divergence_percent = std::nan("")}), testing::HasSubstr("divergence_percent"));
  EXPECT_THAT(message({.convergence_m = -2.0}), testing::HasSubstr("convergence_m = -2"));
  EXPECT_THAT(message({}, {0, 6, 3}), testing::HasSubstr("near 0"));
}

}  // namespace
}  // namespace depthtween
