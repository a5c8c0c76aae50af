// A hand-held camera sweeps through a furnished room: everything moves in the picture, near things fastest, and thin
// chair legs uncover what is behind them. A ball rolls by and a lamp swings.
#include <cmath>
#include <string>

#include "core/synthetic/random.h"
#include "core/synthetic/scenes.h"
#include "core/synthetic/stage.h"

namespace depthtween {
namespace {

void AddChair(Scene& scene, const std::string& name, const Affine& place, const Paint& wood, const Paint& cushion) {
  const int chair = scene.AddBody(name);
  const auto rod = [&](const Vec3& a, const Vec3& b, double radius) {
    AddRod(scene, chair, place * a, place * b, radius, wood);
  };
  scene.AddPart(chair, MakeBox(0.42, 0.42, 0.05), place * At(0, 0, 0.45), cushion);
  for (const double x : {-0.18, 0.18}) {
    rod({x, -0.18, 0.02}, {x, -0.18, 0.43}, 0.020);
    rod({x, 0.18, 0.02}, {x, 0.22, 0.95}, 0.020);
    rod({x, -0.18, 0.20}, {x, 0.185, 0.20}, 0.012);
  }
  for (const double z : {0.62, 0.75, 0.88}) rod({-0.18, 0.20, z}, {0.18, 0.20, z}, 0.016);
}

}  // namespace

void BuildPan(Scene& scene, uint64_t seed) {
  AddRoom(scene, {.width = 7.0,
                  .back = 4.9,
                  .floor = {.pattern = Pattern::kTiles,
                            .color = FromSrgb(0xB48E6E),
                            .second_color = FromSrgb(0x6E5644),
                            .pattern_size_m = 0.28F,
                            .grain = 0.5F,
                            .grain_size_m = 0.14F,
                            .seed = seed + 1},
                  .back_wall = {.pattern = Pattern::kStripes,
                                .color = FromSrgb(0xC6CBB4),
                                .second_color = FromSrgb(0xBEC4A8),
                                .pattern_size_m = 0.7F,
                                .grain = 0.25F,
                                .grain_size_m = 0.12F,
                                .seed = seed + 2},
                  .side_wall = {.pattern = Pattern::kBricks,
                                .color = FromSrgb(0xA4705A),
                                .second_color = FromSrgb(0xB8B0A4),
                                .pattern_size_m = 0.09F,
                                .grain = 0.4F,
                                .seed = seed + 3}});
  const Paint plaster{.color = FromSrgb(0xD6CFC2), .grain = 0.45F, .grain_size_m = 0.12F, .seed = seed + 4};
  const int pillars = scene.AddBody("pillars");
  scene.AddPart(pillars, MakeCylinder(0.13, 2.9), At(-0.95, 1.75, 1.45), plaster);
  scene.AddPart(pillars, MakeBox(0.24, 0.24, 2.9), At(1.30, 2.70, 1.45) * Turn(Vec3::UnitZ(), 0.4),
                {.pattern = Pattern::kBricks,
                 .color = FromSrgb(0x9A8A78),
                 .second_color = FromSrgb(0x5C5248),
                 .pattern_size_m = 0.10F,
                 .grain = 0.4F,
                 .seed = seed + 5});

  const Paint wood{.color = FromSrgb(0x8A5A34), .grain = 0.45F, .grain_size_m = 0.06F, .seed = seed + 6};
  AddChair(scene, "red chair", At(-0.15, 2.05, 0) * Turn(Vec3::UnitZ(), 2.7), wood,
           {.pattern = Pattern::kTartan,
            .color = FromSrgb(0xB8403A),
            .second_color = FromSrgb(0x3E3040),
            .pattern_size_m = 0.10F,
            .grain = 0.3F,
            .seed = seed + 7});
  AddChair(scene, "blue chair", At(0.75, 3.55, 0) * Turn(Vec3::UnitZ(), 0.5), wood,
           {.pattern = Pattern::kChecks,
            .color = FromSrgb(0x3A66A0),
            .second_color = FromSrgb(0x2C4C78),
            .pattern_size_m = 0.07F,
            .grain = 0.3F,
            .seed = seed + 8});
  const int table = scene.AddBody("table");
  scene.AddPart(table, MakeBox(1.3, 0.75, 0.05), At(-0.75, 3.55, 0.74),
                {.pattern = Pattern::kPlanks,
                 .color = FromSrgb(0xB08050),
                 .second_color = FromSrgb(0x4A3018),
                 .pattern_size_m = 0.12F,
                 .grain = 0.5F,
                 .grain_size_m = 0.08F,
                 .seed = seed + 9});
  for (const double x : {-1.33, -0.17})
    for (const double y : {3.25, 3.85}) scene.AddPart(table, MakeBox(0.06, 0.06, 0.72), At(x, y, 0.36), wood);
  const int crockery = scene.AddBody("crockery");
  scene.AddPart(crockery, MakeCylinder(0.05, 0.12), At(-0.95, 3.40, 0.825),
                {.color = FromSrgb(0xD0584A), .grain = 0.3F, .seed = seed + 10});
  scene.AddPart(crockery, MakeLimb(0.20, 0.09, 0.05), At(-0.55, 3.60, 0.85),
                {.pattern = Pattern::kMosaic,
                 .color = FromSrgb(0xE8E8F0),
                 .pattern_size_m = 0.06F,
                 .grain = 0.2F,
                 .seed = seed + 11});
  scene.AddPart(crockery, MakeBall(0.09), At(-0.30, 3.45, 0.855),
                {.color = FromSrgb(0x6AA84F), .grain = 0.4F, .grain_size_m = 0.05F, .seed = seed + 12});
  const int shelf = scene.AddBody("shelf");
  const Paint pale{.color = FromSrgb(0xD8C49C), .grain = 0.35F, .grain_size_m = 0.09F, .seed = seed + 13};
  for (const double x : {1.75, 2.85}) scene.AddPart(shelf, MakeBox(0.04, 0.32, 1.9), At(x, 4.68, 0.95), pale);
  for (const double z : {0.10, 0.68, 1.26, 1.88})
    scene.AddPart(shelf, MakeBox(1.1, 0.32, 0.04), At(2.3, 4.68, z), pale);
  const int books = scene.AddBody("books");
  for (int i = 0; i < 15; ++i) {
    const uint64_t bits = RandomBits(seed, 0xB00CU, i);
    const double height = 0.30 + 0.16 * UniformFrom(bits), board = i < 5 ? 0.12 : i < 10 ? 0.70 : 1.28;
    const auto tone = [&](int k) { return 0.08F + 0.5F * static_cast<float>(UniformFrom(RandomBits(bits, k))); };
    scene.AddPart(books, MakeBox(0.11 + 0.05 * UniformFrom(MixBits(bits)), 0.2, height),
                  At(1.92 + 0.19 * (i % 5), 4.66, board + 0.5 * height),
                  {.pattern = Pattern::kStripes,
                   .color = {tone(1), tone(2), tone(3)},
                   .second_color = {tone(4), tone(5), tone(6)},
                   .pattern_size_m = 0.22F,
                   .grain = 0.2F,
                   .seed = seed + 100 + static_cast<uint64_t>(i)});
  }
  AddProp(scene, "picture", MakeBox(1.0, 0.03, 0.7), At(-0.4, 4.87, 1.75),
          {.pattern = Pattern::kMosaic,
           .color = FromSrgb(0xE2DCD2),
           .pattern_size_m = 0.14F,
           .grain = 0.3F,
           .seed = seed + 14});
  AddProp(scene, "sofa", MakeBox(1.5, 0.7, 0.75), At(-2.55, 4.2, 0.375),
          {.color = FromSrgb(0x5E7A6A), .grain = 0.5F, .grain_size_m = 0.07F, .seed = seed + 15});

  const int ball = scene.AddBody("ball", [](double t) {
    // Rolls without slipping, out and back.
    const double x = 1.5 * std::sin(1.7 * t - 0.35);
    return At(x, 2.75, 0.16) * Turn(Vec3::UnitY(), x / 0.16);
  });
  scene.AddPart(ball, MakeBall(0.16), Affine::Identity(),
                {.pattern = Pattern::kPatches,
                 .color = FromSrgb(0xF0C030),
                 .second_color = FromSrgb(0x2E4E9E),
                 .grain = 0.35F,
                 .grain_size_m = 0.06F,
                 .seed = seed + 16});
  const int pendulum = scene.AddBody("hanging lamp", [](double t) {
    return At(0.35, 2.6, 2.9) * Turn(Vec3::UnitY(), 0.30 * std::sin(3.2 * t + 0.5)) *
           Turn(Vec3::UnitX(), 0.12 * std::sin(3.2 * t));
  });
  AddRod(scene, pendulum, {0, 0, 0}, {0, 0, -1.05}, 0.010,
         {.color = FromSrgb(0x303030), .grain = 0.1F, .seed = seed + 17});
  scene.AddPart(pendulum, MakeLimb(0.14, 0.17, 0.07), At(0, 0, -1.18),
                {.pattern = Pattern::kStripes,
                 .color = FromSrgb(0xE8D8B0),
                 .second_color = FromSrgb(0xC08048),
                 .pattern_size_m = 0.07F,
                 .grain = 0.3F,
                 .seed = seed + 18});

  scene.SetCamera([](double t) {
    const double sweep = std::sin(3.0 * t - 0.25);
    return LookAt({0.55 * sweep, -0.15 + 0.05 * std::sin(4.3 * t), 1.30 + 0.03 * std::sin(7.0 * t)},
                  {1.25 * sweep, 3.0, 0.95 + 0.03 * std::sin(5.3 * t + 1.0)});
  });
}

}  // namespace depthtween
