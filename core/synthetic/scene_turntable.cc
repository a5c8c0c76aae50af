// Rotating stages whose objects pass before and behind one another, and a windmill whose thin vanes sweep over them.
#include <cmath>

#include "core/synthetic/random.h"
#include "core/synthetic/scenes.h"
#include "core/synthetic/stage.h"

namespace depthtween {

void BuildTurntable(Scene& scene, uint64_t seed) {
  const double phase = 0.5 * UniformFrom(RandomBits(seed, 0x7412U));
  AddRoom(scene, {.floor = {.pattern = Pattern::kPlanks,
                            .color = FromSrgb(0x8E7355),
                            .second_color = FromSrgb(0x382A1C),
                            .pattern_size_m = 0.16F,
                            .grain = 0.5F,
                            .grain_size_m = 0.10F,
                            .seed = seed + 1},
                  .back_wall = {.pattern = Pattern::kTiles,
                                .color = FromSrgb(0x9DB0B4),
                                .second_color = FromSrgb(0xD8D8D0),
                                .pattern_size_m = 0.22F,
                                .grain = 0.35F,
                                .grain_size_m = 0.15F,
                                .seed = seed + 2},
                  .side_wall = {.color = FromSrgb(0xB8A9A0), .grain = 0.15F, .grain_size_m = 0.5F, .seed = seed + 3}});
  AddProp(scene, "painting", MakeBox(1.3, 0.03, 0.8), At(0.35, 4.57, 1.75),
          {.pattern = Pattern::kMosaic,
           .color = FromSrgb(0xE6E0D6),
           .pattern_size_m = 0.15F,
           .grain = 0.3F,
           .seed = seed + 4});
  AddProp(scene, "crate", MakeBox(0.6, 0.5, 0.7), At(-1.75, 3.9, 0.35) * Turn(Vec3::UnitZ(), 0.3),
          {.pattern = Pattern::kStripes,
           .color = FromSrgb(0xA8804E),
           .second_color = FromSrgb(0x6A4C2A),
           .pattern_size_m = 0.14F,
           .grain = 0.45F,
           .seed = seed + 5});

  const Paint disk{.pattern = Pattern::kChecks,
                   .color = FromSrgb(0x4C5A6A),
                   .second_color = FromSrgb(0x6C7C8C),
                   .pattern_size_m = 0.12F,
                   .grain = 0.35F,
                   .grain_size_m = 0.06F,
                   .seed = seed + 6};
  AddProp(scene, "large plinth", MakeCylinder(0.30, 0.34), At(-0.35, 2.75, 0.17),
          {.color = FromSrgb(0x77706A), .grain = 0.4F, .seed = seed + 7});
  const int large = scene.AddBody(
      "large turntable", [phase](double t) { return At(-0.35, 2.75, 0.34) * Turn(Vec3::UnitZ(), 7.5 * t + phase); });
  scene.AddPart(large, MakeCylinder(0.78, 0.05), At(0, 0, 0.025), disk);
  scene.AddPart(large, MakeBox(0.30, 0.24, 0.62), At(0.42, 0.10, 0.36),
                {.pattern = Pattern::kTartan,
                 .color = FromSrgb(0xC9A23A),
                 .second_color = FromSrgb(0x7A2F2F),
                 .pattern_size_m = 0.13F,
                 .grain = 0.3F,
                 .grain_size_m = 0.06F,
                 .seed = seed + 8});
  scene.AddPart(large, MakeCylinder(0.15, 0.50), At(-0.28, 0.40, 0.30),
                {.pattern = Pattern::kMosaic,
                 .color = FromSrgb(0xF0E6DC),
                 .pattern_size_m = 0.11F,
                 .grain = 0.25F,
                 .seed = seed + 9});
  scene.AddPart(large, MakeBall(0.20), At(-0.25, -0.42, 0.25),
                {.pattern = Pattern::kPatches,
                 .color = FromSrgb(0x3E8E6E),
                 .second_color = FromSrgb(0xE8E4C8),
                 .grain = 0.4F,
                 .seed = seed + 10});
  // A lamp stand in the middle: thin, and always in front of something.
  const Paint brass{.color = FromSrgb(0xB58F3E), .grain = 0.35F, .grain_size_m = 0.05F, .seed = seed + 11};
  AddRod(scene, large, {0, 0, 0.05}, {0, 0, 0.95}, 0.016, brass);
  scene.AddPart(large, MakeLimb(0.16, 0.15, 0.09), At(0, 0, 0.93),
                {.pattern = Pattern::kStripes,
                 .color = FromSrgb(0xE6D6AE),
                 .second_color = FromSrgb(0xB56A4A),
                 .pattern_size_m = 0.08F,
                 .grain = 0.3F,
                 .seed = seed + 12});

  AddProp(scene, "small plinth", MakeCylinder(0.14, 0.62), At(0.72, 1.95, 0.31),
          {.pattern = Pattern::kStripes,
           .color = FromSrgb(0x8A8E92),
           .second_color = FromSrgb(0x5E6266),
           .pattern_size_m = 0.2F,
           .grain = 0.35F,
           .seed = seed + 13});
  const int small = scene.AddBody("small turntable", [phase](double t) {
    return At(0.72, 1.95, 0.62) * Turn(Vec3::UnitZ(), -12.0 * t + 1.3 + phase);
  });
  scene.AddPart(small, MakeCylinder(0.27, 0.03), At(0, 0, 0.015), disk);
  const Paint china{.pattern = Pattern::kTartan,
                    .color = FromSrgb(0xE6EAF0),
                    .second_color = FromSrgb(0x36589A),
                    .pattern_size_m = 0.08F,
                    .grain = 0.25F,
                    .grain_size_m = 0.05F,
                    .seed = seed + 14};
  // A jug: body, neck, a spout on one side and a handle one can look through on the other.
  scene.AddPart(small, MakeEllipsoid(0.13, 0.13, 0.125), At(0, 0, 0.15), china);
  scene.AddPart(small, MakeCylinder(0.07, 0.14), At(0, 0, 0.30), china);
  AddRod(scene, small, {0.11, 0, 0.18}, {0.22, 0, 0.30}, 0.022, china);
  const Vec3 handle[] = {{-0.07, 0, 0.34}, {-0.16, 0, 0.35}, {-0.215, 0, 0.29}, {-0.21, 0, 0.20}, {-0.12, 0, 0.13}};
  for (int i = 0; i + 1 < 5; ++i) AddRod(scene, small, handle[i], handle[i + 1], 0.016, china);

  const int mast = scene.AddBody("mast");
  AddRod(scene, mast, {1.40, 3.15, 0.0}, {1.40, 3.15, 1.50}, 0.045,
         {.pattern = Pattern::kStripes,
          .color = FromSrgb(0xD0CCC0),
          .second_color = FromSrgb(0xB04038),
          .pattern_size_m = 0.24F,
          .grain = 0.3F,
          .seed = seed + 15});
  const int windmill = scene.AddBody("windmill", [phase](double t) {
    return At(1.40, 3.05, 1.50) * Turn(Vec3::UnitZ(), 0.25) * Turn(Vec3::UnitY(), 12.0 * t + phase);
  });
  scene.AddPart(windmill, MakeBall(0.07), Affine::Identity(), brass);
  for (int i = 0; i < 4; ++i) {
    const Affine arm = Turn(Vec3::UnitY(), 0.5 * kPi * i);
    scene.AddPart(windmill, MakeBox(0.16, 0.014, 0.50), arm * At(0.05, 0, 0.40) * Turn(Vec3::UnitZ(), 0.3),
                  {.pattern = Pattern::kMosaic,
                   .color = i % 2 == 0 ? FromSrgb(0xF2D8A0) : FromSrgb(0xA8C8F0),
                   .pattern_size_m = 0.10F,
                   .grain = 0.3F,
                   .seed = seed + 16 + static_cast<uint64_t>(i)});
    scene.AddPart(windmill, MakeLimb(0.62, 0.014, 0.014), arm, brass);
  }

  // A mobile under the ceiling: arms that turn against the large turntable.
  const int mobile = scene.AddBody(
      "mobile", [phase](double t) { return At(-0.95, 3.1, 2.05) * Turn(Vec3::UnitZ(), -7.0 * t + 0.6 + phase); });
  const Paint wire{.color = FromSrgb(0x3A3C40), .grain = 0.2F, .seed = seed + 21};
  AddRod(scene, mobile, {0, 0, 0}, {0, 0, 0.8}, 0.008, wire);
  AddRod(scene, mobile, {-0.5, 0, 0}, {0.5, 0, 0}, 0.010, wire);
  for (const double side : {-1.0, 1.0})
    AddRod(scene, mobile, {0.48 * side, 0, 0}, {0.48 * side, 0, -0.22}, 0.007, wire);
  scene.AddPart(mobile, MakeBox(0.20, 0.20, 0.20), At(0.48, 0, -0.32),
                {.pattern = Pattern::kChecks,
                 .color = FromSrgb(0xD8503A),
                 .second_color = FromSrgb(0xEFD9A8),
                 .pattern_size_m = 0.067F,
                 .grain = 0.3F,
                 .seed = seed + 22});
  scene.AddPart(mobile, MakeEllipsoid(0.10, 0.10, 0.14), At(-0.48, 0, -0.34),
                {.pattern = Pattern::kStripes,
                 .color = FromSrgb(0x3A78B8),
                 .second_color = FromSrgb(0xE4E0CC),
                 .pattern_size_m = 0.08F,
                 .grain = 0.3F,
                 .seed = seed + 23});

  scene.SetCamera([](double) { return LookAt({0.10, -0.05, 1.40}, {0.12, 2.9, 0.92}); });
}

}  // namespace depthtween
