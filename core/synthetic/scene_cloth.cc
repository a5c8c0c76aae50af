// Cloth that bends without stretching: a flag on a pole in front of a curtain, under a camera that drifts.
#include <cmath>
#include <memory>
#include <vector>

#include "core/synthetic/random.h"
#include "core/synthetic/scenes.h"
#include "core/synthetic/stage.h"

namespace depthtween {
namespace {

// Threads along u are curves of constant speed in a horizontal plane: integrating the direction keeps their length, so
// the cloth bends but does not stretch along u, and shears only a little.
std::shared_ptr<const Shape> Flag(double t, double phase) {
  constexpr int kColumns = 60, kRows = 40;
  constexpr double kSpacing = 0.02;
  const double swing = -0.30 + 0.45 * std::sin(7.0 * t - 0.6);
  std::vector<Vec3> nodes((kColumns + 1) * (kRows + 1));
  for (int j = 0; j <= kRows; ++j) {
    const double v = j * kSpacing;
    Vec3 point(0, 0, -v);
    for (int i = 0; i <= kColumns; ++i) {
      nodes[j * (kColumns + 1) + i] = point - Vec3(0, 0, 0.07 * i * kSpacing * i * kSpacing);
      const double u = (i + 0.5) * kSpacing;
      const double strength = 1.10 * (1 - std::exp(-3.5 * u));
      const double heading = swing + strength * std::sin(10.5 * u - 38.0 * t + 2.2 * v + phase) +
                             0.25 * strength * std::sin(23.0 * u - 62.0 * t - 5.0 * v);
      point += kSpacing * Vec3(std::cos(heading), std::sin(heading), 0);
    }
  }
  return std::make_shared<SheetGrid>(kColumns, kRows, kSpacing, std::move(nodes));
}

// Hangs from a rail in folds; a draught moves its lower part.
std::shared_ptr<const Shape> Curtain(double t, double phase) {
  constexpr int kColumns = 72, kRows = 56;
  constexpr double kSpacing = 0.035;
  std::vector<Vec3> nodes((kColumns + 1) * (kRows + 1));
  for (int j = 0; j <= kRows; ++j) {
    const double v = j * kSpacing, loose = v / (kRows * kSpacing);
    Vec3 point(0, 0.16 * loose * loose * std::sin(4.1 * t + phase), -v);
    for (int i = 0; i <= kColumns; ++i) {
      nodes[j * (kColumns + 1) + i] = point;
      const double u = (i + 0.5) * kSpacing;
      const double heading = (0.75 + 0.25 * loose) * std::sin(21.0 * u + 0.4 * std::sin(5.0 * u)) +
                             0.30 * loose * std::sin(4.0 * u - 9.0 * t + phase);
      point += kSpacing * Vec3(std::cos(heading), std::sin(heading), 0);
    }
  }
  return std::make_shared<SheetGrid>(kColumns, kRows, kSpacing, std::move(nodes));
}

}  // namespace

void BuildCloth(Scene& scene, uint64_t seed) {
  const double phase = 2 * kPi * UniformFrom(RandomBits(seed, 0xC107U));
  AddRoom(scene, {.floor = {.pattern = Pattern::kTiles,
                            .color = FromSrgb(0xA9A196),
                            .second_color = FromSrgb(0x5E5850),
                            .pattern_size_m = 0.33F,
                            .grain = 0.5F,
                            .grain_size_m = 0.15F,
                            .seed = seed + 1},
                  .back_wall = {.color = FromSrgb(0xC4AE8C), .grain = 0.3F, .grain_size_m = 0.14F, .seed = seed + 2},
                  .side_wall = {.pattern = Pattern::kBricks,
                                .color = FromSrgb(0xB07A5C),
                                .second_color = FromSrgb(0xC6BEB0),
                                .pattern_size_m = 0.08F,
                                .grain = 0.4F,
                                .seed = seed + 3}});
  const int curtain = scene.AddBody("curtain", [](double) { return At(-1.75, 4.15, 2.15); });
  scene.AddSheet(curtain, [phase](double t) { return Curtain(t, phase); },
                 {.pattern = Pattern::kStripes,
                  .color = FromSrgb(0x7C8F6A),
                  .second_color = FromSrgb(0x9FB08A),
                  .pattern_size_m = 0.30F,
                  .grain = 0.45F,
                  .grain_size_m = 0.09F,
                  .seed = seed + 4});
  const int rail = scene.AddBody("rail");
  AddRod(scene, rail, {-1.9, 4.15, 2.18}, {0.45, 4.15, 2.18}, 0.022,
         {.color = FromSrgb(0x6A4A30), .grain = 0.3F, .seed = seed + 5});

  const int pole = scene.AddBody("pole");
  const Paint metal{.pattern = Pattern::kStripes,
                    .color = FromSrgb(0xC9CDD2),
                    .second_color = FromSrgb(0x8C9298),
                    .pattern_size_m = 0.12F,
                    .grain = 0.25F,
                    .grain_size_m = 0.05F,
                    .seed = seed + 6};
  AddRod(scene, pole, {-0.72, 2.25, 0.0}, {-0.72, 2.25, 1.95}, 0.022, metal);
  scene.AddPart(pole, MakeBall(0.045), At(-0.72, 2.25, 1.99),
                {.color = FromSrgb(0xD9A93A), .grain = 0.2F, .seed = seed + 7});
  scene.AddPart(pole, MakeCylinder(0.22, 0.06), At(-0.72, 2.25, 0.03),
                {.color = FromSrgb(0x55585C), .grain = 0.4F, .seed = seed + 8});
  const int flag = scene.AddBody("flag", [](double) { return At(-0.70, 2.25, 1.83); });
  scene.AddSheet(flag, [phase](double t) { return Flag(t, phase); },
                 {.pattern = Pattern::kTartan,
                  .color = FromSrgb(0xC8433A),
                  .second_color = FromSrgb(0x2B4A86),
                  .pattern_size_m = 0.20F,
                  .grain = 0.4F,
                  .grain_size_m = 0.08F,
                  .seed = seed + 9});

  AddProp(scene, "cabinet", MakeBox(0.9, 0.45, 0.95), At(1.55, 3.75, 0.475),
          {.pattern = Pattern::kPlanks,
           .color = FromSrgb(0x8C6A48),
           .second_color = FromSrgb(0x3E2C1C),
           .pattern_size_m = 0.16F,
           .grain = 0.5F,
           .grain_size_m = 0.07F,
           .seed = seed + 10});
  AddProp(scene, "globe", MakeBall(0.19), At(1.35, 3.7, 1.14),
          {.pattern = Pattern::kMosaic,
           .color = FromSrgb(0xE8F0F0),
           .pattern_size_m = 0.09F,
           .grain = 0.3F,
           .seed = seed + 11});
  AddProp(scene, "picture", MakeBox(0.75, 0.03, 0.55), At(1.45, 4.56, 1.85),
          {.pattern = Pattern::kMosaic,
           .color = FromSrgb(0xE0E0E0),
           .pattern_size_m = 0.11F,
           .grain = 0.3F,
           .seed = seed + 12});
  const int stool = scene.AddBody("stool");
  const Paint beech{.color = FromSrgb(0xCFA56E), .grain = 0.4F, .grain_size_m = 0.07F, .seed = seed + 13};
  scene.AddPart(stool, MakeCylinder(0.19, 0.04), At(0.75, 2.7, 0.52), beech);
  for (int i = 0; i < 4; ++i) {
    const double angle = 0.5 * kPi * i + 0.4;
    AddRod(scene, stool, {0.75 + 0.20 * std::cos(angle), 2.7 + 0.20 * std::sin(angle), 0.02},
           {0.75 + 0.11 * std::cos(angle), 2.7 + 0.11 * std::sin(angle), 0.5}, 0.016, beech);
  }

  scene.SetCamera([](double t) {
    return LookAt({0.10 + 0.12 * std::sin(3.0 * t), -0.15, 1.22 + 0.02 * std::sin(3.1 * t)},
                  {0.02 + 0.42 * std::sin(3.0 * t), 2.6, 1.12});
  });
}

}  // namespace depthtween
