// A figure of rigid limbs kicks a ball that hangs on a cord. Seen from the side, the kicking leg crosses the standing
// one; wall bars behind give thin, regular structure.
#include <cmath>
#include <memory>

#include "core/synthetic/scenes.h"
#include "core/synthetic/stage.h"

namespace depthtween {
namespace {

constexpr double kPeriod = 1.4;    // seconds from kick to kick
constexpr double kStrike = 0.115;  // when the foot meets the ball

// Angles in degrees at the joints in the plane of the kick, positive forward (towards -x), and how far the chest turns.
// Forward kinematics: each function gives world_from_limb with the limb's own joint as origin and the limb along -z
// (the torso along +z).
class Figure {
 public:
  Affine Pelvis(double t) const { return At(sway_(t), 2.35, 0.955) * Turn(Vec3::UnitZ(), Rad(0.6 * turn_(t))); }
  Affine Torso(double t) const {
    return Pelvis(t) * At(0, 0, 0.06) * Turn(Vec3::UnitY(), Rad(lean_(t))) * Turn(Vec3::UnitZ(), Rad(-1.3 * turn_(t)));
  }
  Affine Head(double t) const { return Torso(t) * At(0, 0, 0.56) * Turn(Vec3::UnitY(), Rad(-0.7 * lean_(t))); }
  // side: +1 the leg away from the camera, -1 the near, kicking leg.
  Affine Thigh(double t, int side) const {
    return Pelvis(t) * At(0, 0.095 * side, -0.02) * Turn(Vec3::UnitY(), Rad(side < 0 ? hip_(t) : stand_hip_(t))) *
           Turn(Vec3::UnitX(), Rad(3.0 * side));
  }
  Affine Shin(double t, int side) const {
    return Thigh(t, side) * At(0, 0, -0.43) * Turn(Vec3::UnitY(), -Rad(side < 0 ? knee_(t) : stand_knee_(t)));
  }
  Affine Foot(double t, int side) const {
    return Shin(t, side) * At(0, 0, -0.42) * Turn(Vec3::UnitY(), Rad(side < 0 ? ankle_(t) : 0.0));
  }
  Affine UpperArm(double t, int side) const {
    return Torso(t) * At(0, 0.20 * side, 0.46) * Turn(Vec3::UnitX(), Rad(14.0 * side)) *
           Turn(Vec3::UnitY(), Rad(side < 0 ? near_arm_(t) : far_arm_(t)));
  }
  Affine Forearm(double t, int side) const {
    return UpperArm(t, side) * At(0, 0, -0.29) * Turn(Vec3::UnitY(), Rad(side < 0 ? 35.0 : 50.0));
  }

 private:
  static double Rad(double degrees) { return degrees * kPi / 180; }

  const PeriodicCurve hip_{
      kPeriod,
      {{0.0, -22}, {0.06, 12}, {kStrike, 52}, {0.17, 78}, {0.30, 70}, {0.55, 25}, {0.85, 0}, {1.1, -18}, {1.28, -34}}};
  const PeriodicCurve knee_{
      kPeriod,
      {{0.0, 78}, {0.06, 68}, {kStrike, 22}, {0.17, 6}, {0.30, 20}, {0.55, 35}, {0.85, 10}, {1.1, 30}, {1.28, 66}}};
  const PeriodicCurve ankle_{kPeriod, {{0.0, -25}, {kStrike, -38}, {0.30, -20}, {0.7, 0}, {1.2, -10}}};
  const PeriodicCurve stand_hip_{kPeriod, {{0.0, 9}, {0.2, -5}, {0.7, 2}, {1.2, 10}}};
  const PeriodicCurve stand_knee_{kPeriod, {{0.0, 16}, {0.2, 10}, {0.7, 4}}};
  const PeriodicCurve lean_{kPeriod, {{0.0, -4}, {kStrike, 8}, {0.25, 16}, {0.7, 2}, {1.1, -3}}};
  const PeriodicCurve turn_{kPeriod, {{0.0, -14}, {kStrike, 6}, {0.25, 16}, {0.7, 0}, {1.15, -10}}};
  const PeriodicCurve near_arm_{kPeriod, {{0.0, 42}, {0.15, -35}, {0.3, -42}, {0.7, -5}, {1.15, 25}}};
  const PeriodicCurve far_arm_{kPeriod, {{0.0, -40}, {0.15, 38}, {0.3, 45}, {0.7, 5}, {1.15, -25}}};
  const PeriodicCurve sway_{kPeriod, {{0.0, 0.10}, {0.2, -0.10}, {0.7, 0.0}, {1.2, 0.12}}};
};

}  // namespace

void BuildKick(Scene& scene, uint64_t seed) {
  AddRoom(scene, {.width = 5.4,
                  .back = 4.4,
                  .floor = {.pattern = Pattern::kPlanks,
                            .color = FromSrgb(0xD2A56D),
                            .second_color = FromSrgb(0x6A4A28),
                            .pattern_size_m = 0.11F,
                            .grain = 0.4F,
                            .grain_size_m = 0.09F,
                            .seed = seed + 1},
                  .back_wall = {.color = FromSrgb(0xB9C2BE), .grain = 0.25F, .grain_size_m = 0.15F, .seed = seed + 2},
                  .side_wall = {.pattern = Pattern::kTiles,
                                .color = FromSrgb(0x8FA08A),
                                .second_color = FromSrgb(0xC8C8C0),
                                .pattern_size_m = 0.3F,
                                .grain = 0.25F,
                                .seed = seed + 3}});
  // Painted lines of a playing field.
  const int lines = scene.AddBody("lines");
  const Paint white{.color = FromSrgb(0xE4E6E8), .grain = 0.12F, .grain_size_m = 0.06F, .seed = seed + 4};
  const Paint blue{.color = FromSrgb(0x2F5FA8), .grain = 0.15F, .grain_size_m = 0.06F, .seed = seed + 5};
  scene.AddPart(lines, MakeBox(5.4, 0.06, 0.002), At(0, 3.1, 0.001), white, false);
  scene.AddPart(lines, MakeBox(0.06, 7.0, 0.002), At(-0.9, 0.8, 0.0012) * Turn(Vec3::UnitZ(), -0.25), blue, false);

  const int bars = scene.AddBody("wall bars");
  const Paint pine{.color = FromSrgb(0xC99B5E), .grain = 0.35F, .grain_size_m = 0.10F, .seed = seed + 6};
  for (const double x : {-1.95, -0.95, 0.05}) scene.AddPart(bars, MakeBox(0.07, 0.13, 2.5), At(x, 4.30, 1.25), pine);
  for (int i = 0; i < 12; ++i)
    AddRod(scene, bars, {-1.95, 4.26, 0.22 + 0.2 * i}, {0.05, 4.26, 0.22 + 0.2 * i}, 0.019, pine);

  AddProp(scene, "mat", MakeBox(1.3, 0.9, 0.24), At(1.55, 3.65, 0.12) * Turn(Vec3::UnitZ(), 0.12),
          {.pattern = Pattern::kChecks,
           .color = FromSrgb(0x2C5C8C),
           .second_color = FromSrgb(0x244A70),
           .pattern_size_m = 0.3F,
           .grain = 0.3F,
           .grain_size_m = 0.07F,
           .seed = seed + 7});
  const int vault = scene.AddBody("vaulting box");
  const Paint wood{.pattern = Pattern::kStripes,
                   .color = FromSrgb(0xB98148),
                   .second_color = FromSrgb(0xA06C38),
                   .pattern_size_m = 0.16F,
                   .grain = 0.4F,
                   .grain_size_m = 0.12F,
                   .seed = seed + 8};
  scene.AddPart(vault, MakeBox(1.0, 0.5, 0.85), At(1.65, 3.75, 0.66), wood);
  scene.AddPart(vault, MakeLimb(0.8, 0.14, 0.14), AlongSegment({1.25, 3.75, 1.06}, {2.05, 3.75, 1.06}),
                {.color = FromSrgb(0x7A5236), .grain = 0.35F, .seed = seed + 9});
  AddProp(scene, "poster", MakeBox(0.7, 0.02, 0.95), At(1.0, 4.38, 1.85),
          {.pattern = Pattern::kMosaic,
           .color = FromSrgb(0xE6E6E6),
           .pattern_size_m = 0.14F,
           .grain = 0.15F,
           .seed = seed + 10});
  const int medicine_balls = scene.AddBody("medicine balls");
  scene.AddPart(medicine_balls, MakeBall(0.17), At(-1.75, 3.55, 0.17),
                {.pattern = Pattern::kPatches,
                 .color = FromSrgb(0x7C4A2A),
                 .second_color = FromSrgb(0x55301A),
                 .grain = 0.4F,
                 .seed = seed + 11});
  scene.AddPart(medicine_balls, MakeBall(0.13), At(-1.38, 3.35, 0.13),
                {.pattern = Pattern::kStripes,
                 .color = FromSrgb(0x34774F),
                 .second_color = FromSrgb(0xD8D4C0),
                 .pattern_size_m = 0.1F,
                 .grain = 0.3F,
                 .seed = seed + 12});

  const auto figure = std::make_shared<const Figure>();
  const Paint shirt{.pattern = Pattern::kTartan,
                    .color = FromSrgb(0xB83A34),
                    .second_color = FromSrgb(0x2C3350),
                    .pattern_size_m = 0.085F,
                    .grain = 0.35F,
                    .grain_size_m = 0.05F,
                    .seed = seed + 20};
  const Paint sleeve{.pattern = Pattern::kStripes,
                     .color = FromSrgb(0xB83A34),
                     .second_color = FromSrgb(0x2C3350),
                     .pattern_size_m = 0.07F,
                     .grain = 0.35F,
                     .grain_size_m = 0.05F,
                     .seed = seed + 21};
  const Paint jeans{.color = FromSrgb(0x3F5F8C), .grain = 0.65F, .grain_size_m = 0.05F, .seed = seed + 22};
  const Paint skin{.color = FromSrgb(0xD9A684), .grain = 0.22F, .grain_size_m = 0.06F, .seed = seed + 23};
  const Paint hair{.color = FromSrgb(0x3B2A1E), .grain = 0.5F, .grain_size_m = 0.03F, .seed = seed + 24};
  const Paint shoe{.color = FromSrgb(0xE6DFD2), .grain = 0.45F, .grain_size_m = 0.035F, .seed = seed + 25};
  const auto body = [&](const char* name, auto place) {
    return scene.AddBody(name, [figure, place](double t) { return place(*figure, t); });
  };
  const Affine down = Turn(Vec3::UnitX(), kPi);  // limbs hang from their joints

  const int pelvis = body("pelvis", [](const Figure& f, double t) { return f.Pelvis(t); });
  scene.AddPart(pelvis, MakeEllipsoid(0.125, 0.17, 0.12), Affine::Identity(), jeans);
  const int torso = body("torso", [](const Figure& f, double t) { return f.Torso(t); });
  scene.AddPart(torso, MakeEllipsoid(0.115, 0.165, 0.22), At(0, 0, 0.12), shirt);
  scene.AddPart(torso, MakeEllipsoid(0.13, 0.20, 0.21), At(0, 0, 0.33), shirt);
  scene.AddPart(torso, MakeLimb(0.14, 0.055, 0.05), At(0.01, 0, 0.48), skin);
  const int head = body("head", [](const Figure& f, double t) { return f.Head(t); });
  scene.AddPart(head, MakeEllipsoid(0.095, 0.078, 0.118), At(-0.015, 0, 0.13), skin);
  scene.AddPart(head, MakeEllipsoid(0.098, 0.085, 0.10), At(0.015, 0, 0.165), hair);
  scene.AddPart(head, MakeLimb(0.02, 0.02, 0.016), At(-0.115, 0, 0.115), skin);
  for (const int side : {1, -1}) {
    const char* const names[2][6] = {
        {"far thigh", "far shin", "far foot", "far upper arm", "far forearm", "far hand"},
        {"near thigh", "near shin", "near foot", "near upper arm", "near forearm", "near hand"}};
    const auto& name = names[side < 0 ? 1 : 0];
    const int thigh = body(name[0], [side](const Figure& f, double t) { return f.Thigh(t, side); });
    scene.AddPart(thigh, MakeLimb(0.41, 0.090, 0.066), down, jeans);
    const int shin = body(name[1], [side](const Figure& f, double t) { return f.Shin(t, side); });
    scene.AddPart(shin, MakeLimb(0.38, 0.064, 0.045), down, jeans);
    const int foot = body(name[2], [side](const Figure& f, double t) { return f.Foot(t, side); });
    scene.AddPart(foot, MakeLimb(0.17, 0.048, 0.036), AlongSegment({0.03, 0, -0.035}, {-0.14, 0, -0.05}), shoe);
    const int upper_arm = body(name[3], [side](const Figure& f, double t) { return f.UpperArm(t, side); });
    scene.AddPart(upper_arm, MakeLimb(0.28, 0.058, 0.044), down, sleeve);
    const int forearm = body(name[4], [side](const Figure& f, double t) { return f.Forearm(t, side); });
    scene.AddPart(forearm, MakeLimb(0.24, 0.042, 0.030), down, skin);
    scene.AddPart(forearm, MakeEllipsoid(0.042, 0.03, 0.062), At(0, 0, -0.29), skin);
  }

  // The ball hangs where the foot strikes, and swings out and back until the next kick.
  const Vec3 ball_at_rest = figure->Foot(kStrike, -1) * Vec3(-0.10, 0, -0.03) + Vec3(-0.16, 0, 0.03);
  const Vec3 hook(ball_at_rest.x(), ball_at_rest.y(), 2.88);
  const double cord = hook.z() - ball_at_rest.z();
  const auto swing = [hook, cord](double t) {
    const double since = t - kStrike - kPeriod * std::floor((t - kStrike) / kPeriod);
    const double fade = 1 - since / kPeriod;
    return At(hook.x(), hook.y(), hook.z()) * Turn(Vec3::UnitY(), 1.05 * std::sin(3.4 * since) * fade * fade) *
           At(0, 0, -cord);
  };
  const int ball = scene.AddBody("ball", swing);
  scene.AddPart(ball, MakeBall(0.14), Affine::Identity(),
                {.pattern = Pattern::kPatches,
                 .color = FromSrgb(0xEDE8D8),
                 .second_color = FromSrgb(0xC2571A),
                 .grain = 0.35F,
                 .grain_size_m = 0.06F,
                 .seed = seed + 30});
  AddRod(scene, ball, {0, 0, 0.1}, {0, 0, cord}, 0.009,
         {.color = FromSrgb(0xC9BFA4), .grain = 0.3F, .seed = seed + 31});

  scene.SetCamera([](double) { return LookAt({-0.22, 0.0, 1.15}, {-0.28, 2.4, 0.93}); });
}

}  // namespace depthtween
