// Cleaning of depth maps whose mixtures, holes and noise were planted; medians against sorting.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "core/fill/key_cleaning.h"
#include "core/fill/weighted_median.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr DepthNoise kQuiet{.a_m = 0.001F, .b_per_m = 0.0F};

// Near (1 m, dark) left of column `edge`, far (3 m, bright) from it on.
struct Step {
  Image<float> depth;
  Image<Rgb8> color;
};
Step MakeStep(int width, int height, int edge) {
  Step step{Image<float>(width, height), Image<Rgb8>(width, height)};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      step.depth(x, y) = x < edge ? 1.0F : 3.0F;
      step.color(x, y) = x < edge ? Rgb8{40, 40, 40} : Rgb8{200, 190, 180};
    }
  return step;
}

// Mixtures are planted at the edge; exactly they must go.
TEST(RemoveFlyingPixels, TakesMixturesAndLeavesSurfaces) {
  Step step = MakeStep(20, 12, 10);
  for (const int y : {2, 5, 8}) step.depth(10, y) = 1.9F;
  const Image<float> out = RemoveFlyingPixels(step.depth, kQuiet, 1);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 20; ++x)
      EXPECT_EQ(out(x, y), x == 10 && (y == 2 || y == 5 || y == 8) ? 0.0F : step.depth(x, y)) << x << "," << y;
}

TEST(RemoveFlyingPixels, LeavesASlant) {
  Image<float> slant(30, 20);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 30; ++x) slant(x, y) = 1.0F / (0.8F - 0.01F * static_cast<float>(x));
  const Image<float> out = RemoveFlyingPixels(slant, kQuiet, 2);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 30; ++x) EXPECT_EQ(out(x, y), slant(x, y));
}

// Three looks at a wall that stands still, noise planted in each: a mixture that two witnesses contradict goes, a
// drop-out is filled, noise is averaged. Where the colours changed, a witness is not heard.
TEST(SettleWhereStill, BelievesWitnessesOnlyOfWhatStoodStill) {
  const Image<Rgb8> color(40, 20, Rgb8{90, 100, 110});
  Image<Rgb8> changed = color.Clone();
  for (int y = 0; y < 20; ++y)
    for (int x = 20; x < 40; ++x) changed(x, y) = {200, 100, 30};
  Image<float> own(40, 20, 2.0F), first(40, 20, 2.001F), second(40, 20, 1.999F);
  for (const int x : {8, 32}) own(x, 10) = 1.2F;   // a mixture
  for (const int x : {12, 36}) own(x, 10) = 0.0F;  // a drop-out
  own(5, 5) = 2.0015F;
  const Image<float> out = SettleWhereStill(own, color, {{first, color}, {second, color}}, kQuiet, 2);
  EXPECT_NEAR(out(8, 10), 2.0F, 1e-5F);
  EXPECT_NEAR(out(12, 10), 2.0F, 1e-5F);
  EXPECT_NEAR(out(5, 5), 2.0005F, 1e-5F);  // (2.0015 + 2.001 + 1.999) / 3
  const Image<float> moved = SettleWhereStill(own, color, {{first, changed}, {second, changed}}, kQuiet, 2);
  EXPECT_NEAR(moved(8, 10), 2.0F, 1e-5F);
  EXPECT_EQ(moved(32, 10), 1.2F);
  EXPECT_EQ(moved(36, 10), 0.0F);
  const Image<float> alone = SettleWhereStill(own, color, {{first, color}}, kQuiet, 1);
  EXPECT_EQ(alone(8, 10), 1.2F);  // one word against another decides nothing
}

// Of five looks at an edge that flickers between two layers, three decide; two against two, or none of its own against
// one, leave it as it was.
TEST(SettleWhereStill, GoesWithMostOfTheWitnesses) {
  const Image<Rgb8> color(20, 10, Rgb8{90, 100, 110});
  const Image<float> near(20, 10, 1.2F), far(20, 10, 2.0F), unknown(20, 10, 0.0F);
  const auto settled = [&](const Image<float>& own, const std::vector<const Image<float>*>& others) {
    std::vector<DepthWitness> witnesses;
    for (const Image<float>* other : others) witnesses.push_back({*other, color});
    return SettleWhereStill(own, color, witnesses, kQuiet, 1)(5, 5);
  };
  EXPECT_EQ(settled(near, {&far, &near, &far, &far}), 2.0F);
  EXPECT_EQ(settled(near, {&far, &near, &far}), 1.2F);
  EXPECT_EQ(settled(unknown, {&far, &near, &far}), 2.0F);
  EXPECT_EQ(settled(unknown, {&far, &near}), 0.0F);
}

// A textured wall with a large ball before it: the camera stands still as long as the wall does, whatever the ball
// does.
TEST(CameraStoodStill, ByWhatHasTexture) {
  const auto view = [](int camera_x, int ball_x) {
    Image<Rgb8> image(120, 90);
    for (int y = 0; y < 90; ++y)
      for (int x = 0; x < 120; ++x) {
        const bool bright = ((x + camera_x) / 5 + y / 5) % 2 == 0;
        const bool ball = std::hypot(x - ball_x, y - 45) < 25;
        const auto level = static_cast<uint8_t>(bright ? 200 : 60);
        image(x, y) = ball ? Rgb8{level, 40, 40} : Rgb8{level, level, level};
      }
    return image;
  };
  EXPECT_TRUE(CameraStoodStill(view(0, 40), view(0, 40)));
  EXPECT_TRUE(CameraStoodStill(view(0, 40), view(0, 60)));
  EXPECT_FALSE(CameraStoodStill(view(0, 40), view(2, 40)));
  const Image<Rgb8> plain(60, 40, Rgb8{90, 90, 90});
  EXPECT_FALSE(CameraStoodStill(plain, plain));
}

// A hole across a colour edge: each side belongs to the surface of its colour.
TEST(FillAlongColor, StopsAtColourEdges) {
  Step step = MakeStep(40, 20, 20);
  Image<float> holed = step.depth.Clone();
  for (int y = 5; y < 15; ++y)
    for (int x = 14; x < 26; ++x) holed(x, y) = 0;
  const FilledDepth filled = FillAlongColor(holed, step.color);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 40; ++x) {
      EXPECT_EQ(filled.depth_m(x, y), step.depth(x, y)) << x << "," << y;
      EXPECT_EQ(filled.distance(x, y) == 0, holed(x, y) > 0);
    }
}

TEST(FillAlongColor, KnowsNothingFromNothing) {
  const Image<Rgb8> color(8, 8);
  const FilledDepth filled = FillAlongColor(Image<float>(8, 8), color);
  for (size_t i = 0; i < 64; ++i) EXPECT_EQ(filled.depth_m.data()[i], 0.0F);
}

// A plane in space is affine in inverse depth: it must come back unchanged; with noise added, closer to itself.
TEST(DenoiseInLayers, KeepsPlanesAndHalvesNoise) {
  Image<float> plane(60, 40), noisy(60, 40);
  const Image<float> distance(60, 40);
  const Image<Rgb8> color(60, 40, Rgb8{100, 100, 100});
  std::mt19937 random(7);
  std::normal_distribution<float> noise(0, 0.003F);
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 60; ++x) {
      plane(x, y) = 1.0F / (0.5F + 0.001F * static_cast<float>(x) - 0.0005F * static_cast<float>(y));
      noisy(x, y) = plane(x, y) + noise(random);
    }
  const DepthNoise model{.a_m = 0.003F, .b_per_m = 0};
  const Image<float> same = DenoiseInLayers(plane, distance, color, model, 3, 1);
  const Image<float> clean = DenoiseInLayers(noisy, distance, color, model, 3, 2);
  double before = 0, after = 0;
  for (size_t i = 0; i < plane.pixel_count(); ++i) {
    EXPECT_NEAR(same.data()[i], plane.data()[i], 3e-4F);  // the damping of one-sided windows at the border
    before += std::pow(noisy.data()[i] - plane.data()[i], 2);
    after += std::pow(clean.data()[i] - plane.data()[i], 2);
  }
  EXPECT_LT(std::sqrt(after), 0.5 * std::sqrt(before));
}

// One pixel at a time, as the header says it: what the lanes must agree with.
float PlainFit(const Image<float>& depth, const Image<float>& distance, const Image<Rgb8>& color,
               const DepthNoise& noise, int radius, int x, int y) {
  const double z = depth(x, y);
  if (z <= 0) return 0.0F;
  const double sigma = noise.a_m + noise.b_per_m * z * z, inverse = 1 / z;
  double c0 = inverse, cx = 0, cy = 0;
  bool fitted = false;
  for (int round = 0; round < 2; ++round) {
    double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0, sv = 0, sxv = 0, syv = 0;
    for (int dy = -radius; dy <= radius; ++dy)
      for (int dx = -radius; dx <= radius; ++dx) {
        if (!depth.Contains(x + dx, y + dy) || depth(x + dx, y + dy) <= 0) continue;
        const double v = 1.0 / depth(x + dx, y + dy);
        const double allowed =
            3 * sigma * inverse * inverse + (round == 0 ? 0.008 * inverse * std::max(std::abs(dx), std::abs(dy)) : 0);
        if (std::abs(v - (c0 + cx * dx + cy * dy)) > allowed) continue;
        const Rgb8 a = color(x, y), b = color(x + dx, y + dy);
        const double colour = (std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b)) / 45.0;
        const double w = 1 / ((1 + distance(x + dx, y + dy)) * (1 + colour * colour));
        s += w, sx += w * dx, sy += w * dy, sxx += w * dx * dx, sxy += w * dx * dy, syy += w * dy * dy;
        sv += w * (v - inverse), sxv += w * dx * (v - inverse), syv += w * dy * (v - inverse);
      }
    if (s < 2) break;
    const double mx = sx / s, my = sy / s, mv = sv / s, damping = 0.02 * s;
    const double a = sxx - sx * mx + damping, b = sxy - sx * my, d = syy - sy * my + damping;
    const double e = sxv - sx * mv, f = syv - sy * mv, determinant = a * d - b * b;
    cx = (e * d - b * f) / determinant, cy = (a * f - b * e) / determinant;
    c0 = inverse + mv - cx * mx - cy * my;
    fitted = c0 > 0;
    if (!fitted) break;
  }
  return static_cast<float>(fitted && std::abs(1 / c0 - z) <= 4 * sigma ? 1 / c0 : z);
}

// Random surfaces, holes, filled pixels and colours, in a width that leaves lanes over. A neighbour that lies on its
// gate to the last bit may fall on either side of it.
TEST(DenoiseInLayers, AgreesWithFittingPixelByPixel) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> uniform(0, 1);
  Image<float> depth(45, 23), distance(45, 23);
  Image<Rgb8> color(45, 23);
  for (int y = 0; y < 23; ++y)
    for (int x = 0; x < 45; ++x) {
      depth(x, y) = uniform(random) < 0.1F ? 0.0F : (x + y < 35 ? 1.5F + 0.01F * x : 3.0F) + 0.01F * uniform(random);
      distance(x, y) = uniform(random) < 0.3F ? 5 * uniform(random) : 0.0F;
      const auto level = static_cast<uint8_t>(90 * uniform(random));
      color(x, y) = {level, static_cast<uint8_t>(level / 2), static_cast<uint8_t>(255 - level)};
    }
  const DepthNoise noise{.a_m = 0.002F, .b_per_m = 0.001F};
  for (const int radius : {1, 3, kMaxDenoiseRadius}) {
    const Image<float> out = DenoiseInLayers(depth, distance, color, noise, radius, 2);
    int differing = 0;
    for (int y = 0; y < 23; ++y)
      for (int x = 0; x < 45; ++x)
        differing += std::abs(out(x, y) - PlainFit(depth, distance, color, noise, radius, x, y)) > 1e-5F;
    EXPECT_LE(differing, 3) << radius;
  }
}

TEST(DenoiseInLayers, NeverMixesLayers) {
  const Step step = MakeStep(30, 20, 15);
  const Image<float> out = DenoiseInLayers(step.depth, Image<float>(30, 20), step.color, kQuiet, 3, 1);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 30; ++x) EXPECT_NEAR(out(x, y), step.depth(x, y), 1e-4F);
}

// The oracle sorts all votes and walks to half the weight.
float SlowMedian(const Image<float>& depth, const Image<float>& confidence, const Image<Rgb8>& color, int x, int y,
                 const WeightedMedianOptions& o) {
  std::vector<std::pair<float, double>> votes;
  double total = 0;
  for (int ny = std::max(0, y - o.radius); ny <= std::min(depth.height() - 1, y + o.radius); ++ny)
    for (int nx = std::max(0, x - o.radius); nx <= std::min(depth.width() - 1, x + o.radius); ++nx) {
      if (depth(nx, ny) <= 0 || confidence(nx, ny) <= 0) continue;
      const Rgb8 a = color(x, y), b = color(nx, ny);
      const double d = (std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b)) / (3.0 * o.color_sigma);
      const double s = ((nx - x) * (nx - x) + (ny - y) * (ny - y)) / (o.space_sigma * o.space_sigma);
      const double w = (std::exp(-0.5 * d * d) + 1e-4) * std::exp(-0.5 * s) * confidence(nx, ny);
      votes.emplace_back(depth(nx, ny), w);
      total += w;
    }
  std::sort(votes.begin(), votes.end());
  double below = 0;
  for (const auto& [z, w] : votes)
    if ((below += w) >= 0.5 * total) return z;
  return votes.back().first;
}

TEST(WeightedMedian, AgreesWithSorting) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  Image<float> depth(24, 18), confidence(24, 18);
  Image<Rgb8> color(24, 18);
  for (size_t i = 0; i < depth.pixel_count(); ++i) {
    depth.data()[i] = uniform(random) < 0.1F ? 0.0F : 1.0F + uniform(random);
    confidence.data()[i] = uniform(random);
    const auto level = static_cast<uint8_t>(20 * uniform(random));
    color.data()[i] = {level, level, static_cast<uint8_t>(level / 2)};
  }
  Image<uint8_t> mask(24, 18, uint8_t{1});
  mask(3, 3) = 0;
  const WeightedMedianOptions options{.radius = 4};
  const Image<float> out = WeightedMedian({depth, confidence, color}, {}, mask, options, 2);
  int differing = 0;
  for (int y = 0; y < 18; ++y)
    for (int x = 0; x < 24; ++x) {
      if (x == 3 && y == 3) {
        EXPECT_EQ(out(x, y), depth(x, y));
      } else if (out(x, y) != SlowMedian(depth, confidence, color, x, y, options)) {
        ++differing;  // a vote that falls on the half to the last bit may go either way
      }
    }
  EXPECT_LE(differing, 1);
}

// A stick three pixels wide before a wide wall of another colour keeps its depth.
TEST(WeightedMedian, KeepsThinThings) {
  Image<float> depth(40, 30, 3.0F);
  Image<Rgb8> color(40, 30, Rgb8{200, 200, 200});
  for (int y = 0; y < 30; ++y)
    for (int x = 18; x < 21; ++x) depth(x, y) = 1.0F, color(x, y) = {60, 80, 90};
  const Image<float> sure(40, 30, 1.0F);
  const Image<float> out = WeightedMedian({depth, sure, color}, {}, Image<uint8_t>(40, 30, uint8_t{1}), {}, 1);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) EXPECT_EQ(out(x, y), depth(x, y));
}

// A frame alone is wrong about an edge; two frames around it, in which everything has moved by three pixels, are right
// and outvote it. Without colour to go by, so that the votes alone decide.
TEST(WeightedMedian, WitnessesOutvoteAnEdgeThatOneFrameGotWrong) {
  const auto edge_at = [](int column) {
    Image<float> depth(40, 30, 3.0F);
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < column; ++x) depth(x, y) = 1.0F;
    return depth;
  };
  const Image<float> wrong = edge_at(21), before = edge_at(17), after = edge_at(23), sure(40, 30, 1.0F);
  const Image<Rgb8> grey(40, 30, Rgb8{90, 90, 90});
  const auto back = [](int, int) { return Flow2{-3, 0}; };
  const auto forth = [](int, int) { return Flow2{3, 0}; };
  const std::vector<MedianWitness> witnesses = {{{before, sure, grey}, back, 1.0F}, {{after, sure, grey}, forth, 1.0F}};
  const Image<uint8_t> everywhere(40, 30, uint8_t{1});
  EXPECT_EQ(WeightedMedian({wrong, sure, grey}, {}, everywhere, {}, 1)(20, 15), 1.0F);
  EXPECT_EQ(WeightedMedian({wrong, sure, grey}, witnesses, everywhere, {}, 1)(20, 15), 3.0F);
  EXPECT_EQ(WeightedMedian({wrong, sure, grey}, witnesses, everywhere, {}, 1)(19, 15), 1.0F);
}

// Three voters in a row at distance 3 and three at distance 2: the nearer row weighs more, though the frame's own
// window reaches neither.
TEST(WeightedMedian, WitnessesMayLookFartherThanTheFrameItself) {
  Image<float> unknown(21, 21, 0.0F), seen(21, 21, 0.0F);
  for (int d = -1; d <= 1; ++d) seen(10 + d, 7) = 3.0F, seen(10 + d, 12) = 2.0F;
  const Image<float> sure(21, 21, 1.0F);
  const Image<Rgb8> grey(21, 21, Rgb8{90, 90, 90});
  const auto still = [](int, int) { return Flow2{}; };
  const std::vector<MedianWitness> witnesses = {{{seen, sure, grey}, still, 1.0F}};
  Image<uint8_t> mask(21, 21, uint8_t{0});
  mask(10, 10) = 1;
  const auto median = [&](int witness_radius) {
    return WeightedMedian({unknown, sure, grey}, witnesses, mask, {.radius = 1, .witness_radius = witness_radius}, 1)(
        10, 10);
  };
  EXPECT_EQ(median(3), 2.0F);
  EXPECT_EQ(median(2), 2.0F);
  EXPECT_EQ(median(1), 0.0F);
}

}  // namespace
}  // namespace depthtween
