// Depth of field against convolution with a disc, and against rays through a real lens.
#include "core/render/depth_of_field.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "core/metrics/color_errors.h"
#include "core/metrics/regions.h"
#include "core/render/lens_layers.h"
#include "core/synthetic/lens_render.h"
#include "core/synthetic/render.h"
#include "core/synthetic/stage.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr DepthOfFieldMethod kMethods[] = {DepthOfFieldMethod::kLayers, DepthOfFieldMethod::kKraus,
                                           DepthOfFieldMethod::kGather};

Image<Rgb8> RandomColor(int width, int height, uint32_t seed) {
  std::mt19937 random(seed);
  Image<Rgb8> image(width, height);
  for (size_t i = 0; i < image.pixel_count(); ++i) {
    const uint32_t bits = random();
    image.data()[i] = {static_cast<uint8_t>(bits), static_cast<uint8_t>(bits >> 8), static_cast<uint8_t>(bits >> 16)};
  }
  return image;
}

Image<float> RandomBlocks(int width, int height, float near_m, float far_m, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> depth(near_m, far_m);
  Image<float> image(width, height);
  for (int by = 0; by < height; by += 16)
    for (int bx = 0; bx < width; bx += 16) {
      const float block = depth(random);
      for (int y = by; y < std::min(height, by + 16); ++y)
        for (int x = bx; x < std::min(width, bx + 16); ++x) image(x, y) = block;
    }
  return image;
}

bool SameBits(const Image<Rgb8>& a, const Image<Rgb8>& b) {
  return std::equal(a.data(), a.data() + a.pixel_count(), b.data());
}

HiddenBackground Behind(const RenderView& view) { return FindHiddenBackground(view, {}, {}, 2); }

// Means of equal colours are that colour, whatever the depth, at borders too.
TEST(RenderDepthOfField, LeavesAConstantImageConstant) {
  for (const Rgb8 value : {Rgb8{255, 255, 255}, Rgb8{3, 1, 2}, Rgb8{200, 118, 40}}) {
    const Image<Rgb8> color(90, 70, value);
    const Image<float> depth = RandomBlocks(90, 70, 0.5F, 6.0F, 3);
    for (const DepthOfFieldMethod method : kMethods) {
      const Image<Rgb8> out = RenderDepthOfField({color, depth}, Behind({color, depth}),
                                                 {.scale_px = 12, .focus_m = 1.5}, {.method = method}, 2);
      for (size_t i = 0; i < out.pixel_count(); ++i) {
        ASSERT_LE(std::abs(out.data()[i].r - value.r), 1);
        ASSERT_LE(std::abs(out.data()[i].g - value.g), 1);
        ASSERT_LE(std::abs(out.data()[i].b - value.b), 1);
      }
    }
  }
}

// What lies within half a pixel of blur is in focus, and then nothing may change, not even by one bit.
TEST(RenderDepthOfField, LeavesWhatIsInFocusBitIdentical) {
  const Image<Rgb8> color = RandomColor(120, 90, 5);
  const Image<float> plane(120, 90, 2.0F), relief = RandomBlocks(120, 90, 1.93F, 2.08F, 6);
  const CircleOfConfusion circle{.scale_px = 12, .focus_m = 2.0};
  for (const DepthOfFieldMethod method : kMethods) {
    EXPECT_TRUE(SameBits(RenderDepthOfField({color, plane}, {}, circle, {.method = method}, 2), color));
    if (method == DepthOfFieldMethod::kKraus) continue;  // blends neighbouring sub-images from the first bit of blur on
    EXPECT_TRUE(
        SameBits(RenderDepthOfField({color, relief}, Behind({color, relief}), circle, {.method = method}, 2), color));
  }
}

// One white pixel on black becomes a disc of radius rho, evenly lit, and no light is lost. Known from the formula.
TEST(BlurInLayers, SpreadsAPixelOverADisc) {
  for (const float rho : {2.0F, 7.25F, -11.5F, 19.0F}) {
    Image<Rgb8> color(81, 81, {0, 0, 0});
    color(40, 40) = {255, 255, 255};
    const CircleOfConfusion circle{.scale_px = 20, .focus_m = 2.0};
    const Image<float> depth(81, 81, 2.0F / (1 - rho / 20));
    const Image<Light> out = BlurInLayers({color, depth}, {}, circle, {}, 2);
    const double expected = 1 / (3.14159265 * rho * rho);
    double energy = 0;
    for (int y = 0; y < 81; ++y)
      for (int x = 0; x < 81; ++x) {
        const double distance = std::hypot(x - 40, y - 40), value = out(x, y)[1];
        energy += value;
        const double inside = distance < std::abs(rho) - 2 ? 1 : distance > std::abs(rho) + 2 ? 0 : value / expected;
        ASSERT_NEAR(value, inside * expected, 0.01 * expected) << x << " " << y;
      }
    EXPECT_NEAR(energy, 1, 0.01) << rho;
  }
}

// A plane facing the camera is convolved with one disc. The convolution is done here pixel by pixel, with the exact
// coverage of each pixel from 16 x 16 points, in the middle, where no border matters.
TEST(RenderDepthOfField, ConvolvesAPlaneWithADisc) {
  const int size = 96, margin = 16;
  const Image<Rgb8> color = RandomColor(size, size, 9);
  const LinearLight& tables = LinearLight::Tables();
  for (const float rho : {1.25F, 3.5F, 9.75F, -12.0F}) {
    const CircleOfConfusion circle{.scale_px = 20, .focus_m = 2.0};
    const Image<float> depth(size, size, 2.0F / (1 - rho / 20));
    const Image<Rgb8> out = RenderDepthOfField({color, depth}, Behind({color, depth}), circle, {}, 2);
    std::vector<std::vector<float>> kernel(2 * margin + 1, std::vector<float>(2 * margin + 1));
    float area = 0;
    for (int y = -margin; y <= margin; ++y)
      for (int x = -margin; x <= margin; ++x)
        for (int i = 0; i < 256; ++i) {
          const bool inside = std::hypot(x + (i % 16 - 7.5) / 16, y + (i / 16 - 7.5) / 16) < std::abs(rho);
          kernel[y + margin][x + margin] += inside;
          area += inside;
        }
    Image<Rgb8> truth(size, size);
    Image<uint8_t> middle(size, size);
    for (int y = margin; y < size - margin; ++y)
      for (int x = margin; x < size - margin; ++x) {
        Light sum = {};
        for (int j = -margin; j <= margin; ++j)
          for (int i = -margin; i <= margin; ++i)
            sum += tables.Decode(color(x + i, y + j)) * kernel[j + margin][i + margin];
        truth(x, y) = tables.Encode(sum / area);
        middle(x, y) = 1;
      }
    ColorErrors errors;
    errors.Add(out, truth, middle);
    EXPECT_GT(errors.PsnrDb(), 45) << rho;
  }
}

// A red card before a grey wall, left half of the picture.
struct Card {
  Image<Rgb8> color{96, 64, {120, 120, 120}};
  Image<float> depth{96, 64, 4.0F};
  Card() {
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 48; ++x) color(x, y) = {220, 20, 20}, depth(x, y) = 1.5F;
  }
};

// The card in focus: the wall is unsharp, and its light comes from the wall alone. Known since the wall is all one
// grey.
TEST(RenderDepthOfField, KeepsTheSubjectOutOfTheBackground) {
  const Card card;
  const CircleOfConfusion circle{.scale_px = 16, .focus_m = 1.5};
  const Image<Rgb8> out = RenderDepthOfField({card.color, card.depth}, Behind({card.color, card.depth}), circle, {}, 2);
  EXPECT_TRUE(SameBits(out, card.color));
}

// The wall in focus: the card's edge spreads to both sides by its circle of confusion, half way at the edge, and the
// wall shines through the card. Known from the integral over a half covered disc.
TEST(RenderDepthOfField, DissolvesAnUnsharpSilhouette) {
  const Card card;
  const CircleOfConfusion circle{.scale_px = 6, .focus_m = 4.0};  // 10 px at the card
  const Image<Rgb8> out = RenderDepthOfField({card.color, card.depth}, Behind({card.color, card.depth}), circle, {}, 2);
  const LinearLight& tables = LinearLight::Tables();
  const float red = tables.Decode(uint8_t{220}), grey = tables.Decode(uint8_t{120});
  for (int x = 48 - 12; x < 48 + 12; ++x) {
    const double t = std::clamp((x - 47.5) / 10.0, -1.0, 1.0);
    const double share = (std::acos(t) - t * std::sqrt(1 - t * t)) / 3.14159265;  // of the disc that meets the card
    EXPECT_NEAR(tables.Decode(out(x, 32).r), share * red + (1 - share) * grey, 0.02) << x;
  }
}

// Colours change little when the focus does: no layer may pop.
TEST(RenderDepthOfField, ChangesSmoothlyWithFocus) {
  const auto scene = *MakeScene("turntable", 1);
  const Camera camera{.width = 128, .height = 106, .fx = 91, .fy = 91, .cx = 63.5, .cy = 52.5};
  const Renderer renderer = RendererAt(*scene, camera, 0.1);
  const Image<Rgb8> color = renderer.Color(2);
  const SurfaceTruth truth = renderer.Surface(2);
  const HiddenBackground hidden = Behind({color, truth.depth_m});
  Image<Rgb8> before;
  for (int step = 0; step < 12; ++step) {
    const CircleOfConfusion circle{.scale_px = 14, .focus_m = 2.6 + 0.01 * step};
    Image<Rgb8> now = RenderDepthOfField({color, truth.depth_m}, hidden, circle, {}, 2);
    if (!before.empty()) {
      ColorErrors change;
      change.Add(now, before, {});
      EXPECT_GT(change.PsnrDb(), 42) << step;
    }
    before = std::move(now);
  }
}

TEST(RenderDepthOfField, DoesNotDependOnThreads) {
  const Image<Rgb8> color = RandomColor(100, 75, 1);
  const Image<float> depth = RandomBlocks(100, 75, 1.0F, 5.0F, 2);
  const HiddenBackground hidden = Behind({color, depth});
  for (const DepthOfFieldMethod method : kMethods) {
    const auto render = [&](int threads) {
      return RenderDepthOfField({color, depth}, hidden, {.scale_px = 9, .focus_m = 2}, {.method = method, .blades = 5},
                                threads);
    };
    EXPECT_TRUE(SameBits(render(1), render(3)));
  }
}

// Small images, unknown depth, the largest radius: nothing reads beyond its images (under sanitizers), nothing is NaN.
TEST(RenderDepthOfField, BearsExtremes) {
  for (const auto& [width, height] : {std::pair{1, 1}, std::pair{3, 40}, std::pair{33, 2}}) {
    const Image<Rgb8> color(width, height, {90, 90, 90});
    Image<float> depth = RandomBlocks(width, height, 0.2F, 9.0F, 4);
    depth(0, 0) = 0;
    for (const DepthOfFieldMethod method : kMethods) {
      // The largest radius once: tables of its shapes take longer than such small images.
      const double max_radius_px = method == DepthOfFieldMethod::kLayers && width == 1 ? 128 : 24;
      const Image<Rgb8> out = RenderDepthOfField({color, depth}, {}, {.scale_px = 500, .focus_m = 1},
                                                 {.method = method, .blades = 3, .max_radius_px = max_radius_px}, 2);
      for (size_t i = 0; i < out.pixel_count(); ++i) ASSERT_NEAR(out.data()[i].g, 90, 1);
    }
  }
}

TEST(DepthOfFieldOptions, SayWhatIsWrong) {
  using testing::StartsWith;
  const auto refusal = [](const DepthOfFieldOptions& options) { return std::string(options.Validate().message()); };
  EXPECT_EQ(refusal({}), "");
  EXPECT_THAT(refusal({.blades = 2}), StartsWith("blades = 2, must be"));
  EXPECT_THAT(refusal({.max_radius_px = 500}), StartsWith("max_radius_px = 500, must be"));
  EXPECT_THAT(refusal({.max_radius_px = -1}), StartsWith("max_radius_px = -1, must be"));
  EXPECT_THAT(refusal({.layers = 1}), StartsWith("layers = 1, must be"));
}

// A real lens decides: of the three methods ours comes closest to it near silhouettes, in front of the focus and
// behind. The benchmark says by how much on the library's scenes, at a size worth looking at.
TEST(RenderDepthOfField, IsNearestToALensAmongTheMethods) {
  Scene scene("card and ball");
  scene.AddPart(scene.AddBody("wall"), MakeBox(9, 0.2, 9), At(0, 4.1, 0),
                {.pattern = Pattern::kMosaic, .pattern_size_m = 0.5F, .seed = 3});
  scene.AddPart(scene.AddBody("card"), MakeBox(0.5, 0.02, 0.7), At(-0.3, 1.5, 0),
                {.pattern = Pattern::kChecks, .color = FromSrgb(0xD02020), .pattern_size_m = 0.2F});
  scene.AddPart(scene.AddBody("ball"), MakeBall(0.25), At(0.4, 2.2, 0.1), {.color = FromSrgb(0x20C040)});
  scene.AddLamp({-1, -1, 1}, 0.8F);
  scene.SetCamera([](double) { return LookAt(Vec3::Zero(), {0, 1, 0}); });
  const Camera camera{.width = 112, .height = 90, .fx = 80, .fy = 80, .cx = 55.5, .cy = 44.5};
  const Renderer renderer = RendererAt(scene, camera, 0);
  const Image<Rgb8> color = renderer.Color(2);
  const SurfaceTruth truth = renderer.Surface(2);
  const RenderView view{color, truth.depth_m};
  const Image<uint8_t> band = DilateDisc(DepthJumps(truth.depth_m), 10);
  for (const CircleOfConfusion& circle : {CircleOfConfusion{9, 1.5}, CircleOfConfusion{4, 4.0}}) {
    const ThinLens lens{.aperture_m = 2 * circle.scale_px * circle.focus_m / camera.fx, .focus_m = circle.focus_m};
    const Image<Rgb8> reference = RenderThroughLens(scene, camera, scene.WorldFromCamera(0), 0, lens, 64, 2);
    std::vector<double> psnr_db;
    for (const DepthOfFieldMethod method : kMethods) {
      ColorErrors errors;
      errors.Add(RenderDepthOfField(view, Behind(view), circle, {.method = method}, 2), reference, band);
      psnr_db.push_back(errors.PsnrDb());
    }
    EXPECT_GT(psnr_db[0], psnr_db[1] + 1) << "kraus, focus at " << circle.focus_m;
    EXPECT_GT(psnr_db[0], psnr_db[2] + 1) << "gather, focus at " << circle.focus_m;
  }
}

}  // namespace
}  // namespace depthtween
