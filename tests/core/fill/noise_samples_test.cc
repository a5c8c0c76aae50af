// The noise model that comes back is the one that was planted.
#include "core/fill/noise_samples.h"

#include <random>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

// Two measurements of a slanted wall with planted noise of 2 mm + 1 mm z^2, standing still.
struct Wall {
  Image<float> before{320, 240}, after{320, 240};
  Image<Rgb8> color{320, 240};
  Wall() {
    std::mt19937 random(1);
    std::normal_distribution<float> normal(0.0F, 1.0F);
    for (int y = 0; y < 240; ++y)
      for (int x = 0; x < 320; ++x) {
        const float z = 1.0F + 0.006F * static_cast<float>(x);
        before(x, y) = z + (0.002F + 0.001F * z * z) * normal(random);
        after(x, y) = z + (0.002F + 0.001F * z * z) * normal(random);
      }
  }
};

// What was planted comes back, over space and over time.
TEST(NoiseSamples, FindsWhatWasPlanted) {
  const Wall wall;
  NoiseSamples space, time;
  space.AddOverSpace(wall.before);
  space.AddOverSpace(wall.after);
  time.AddOverTime({wall.color, wall.before}, {wall.color, wall.after});
  for (NoiseSamples* samples : {&space, &time}) {
    const DepthNoise noise = samples->Fit(1e-4);
    for (const float z : {1.2F, 2.0F, 2.8F}) EXPECT_NEAR(noise.At(z), 0.002F + 0.001F * z * z, 0.1F * noise.At(z));
  }
}

// Where colours changed something moved: no sample; then the model is a known sensor's.
TEST(NoiseSamples, LooksOnlyWhereNothingMoved) {
  const Wall wall;
  NoiseSamples time;
  time.AddOverTime({wall.color, wall.before}, {Image<Rgb8>(320, 240, Rgb8{90, 90, 90}), wall.after});
  EXPECT_EQ(time.Fit(1e-4).a_m, 0.0015F);
  EXPECT_EQ(time.Fit(1e-4).b_per_m, 0.0004F);
}

// Exact depth has the noise of its own steps.
TEST(NoiseSamples, IsNeverBelowTheStep) {
  NoiseSamples space;
  space.AddOverSpace(Image<float>(320, 240, 2.0F));
  EXPECT_NEAR(space.Fit(0.001).At(2.0F), 0.001 / 3.46, 1e-6);
}

}  // namespace
}  // namespace depthtween
