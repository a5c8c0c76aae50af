// Balls that fly, bounce and squash. The large ball's contact with the floor changes the topology of the depth map,
// boxes in front hide the football, a racket's thin rim crosses the picture.
#include <cmath>

#include "core/synthetic/scenes.h"
#include "core/synthetic/stage.h"

namespace depthtween {
namespace {

constexpr double kGravity = 9.81;  // m/s^2

// A ball that falls, is pressed flat against the floor for a moment and flies up again, for ever. The pressing is half
// a sine whose start has the speed of the fall, so the motion has no jerk in velocity.
struct Bounce {
  double radius, impact_speed, squash;  // m, m/s, deepest dip of the centre below the radius in m
  double phase;                         // seconds since the last first touch at time 0

  double ContactTime() const { return kPi * squash / impact_speed; }
  double Period() const { return ContactTime() + 2 * impact_speed / kGravity; }

  // Height of the centre; the ball's vertical scale is height / radius while it touches the floor.
  double Height(double time) const {
    const double shifted = time + phase;
    const double t = shifted - Period() * std::floor(shifted / Period());
    if (t < ContactTime()) return radius - squash * std::sin(kPi * t / ContactTime());
    const double flight = t - ContactTime();
    return radius + impact_speed * flight - 0.5 * kGravity * flight * flight;
  }

  // At (x, y) of the floor, turned, then squashed with its volume kept.
  Affine Place(double time, double x, double y, const Affine& turn) const {
    const double height = Height(time);
    const double flat = std::min(1.0, height / radius);
    return At(x, y, height) * Affine(Eigen::Scaling(1 / std::sqrt(flat), 1 / std::sqrt(flat), flat)) * turn;
  }
};

}  // namespace

void BuildBounce(Scene& scene, uint64_t seed) {
  AddRoom(scene, {.floor = {.pattern = Pattern::kPlanks,
                            .color = FromSrgb(0xC19A6B),
                            .second_color = FromSrgb(0x4A3520),
                            .pattern_size_m = 0.14F,
                            .grain = 0.55F,
                            .grain_size_m = 0.10F,
                            .seed = seed + 1},
                  .back_wall = {.pattern = Pattern::kBricks,
                                .color = FromSrgb(0xA85C48),
                                .second_color = FromSrgb(0xB8B0A4),
                                .pattern_size_m = 0.09F,
                                .grain = 0.45F,
                                .grain_size_m = 0.25F,
                                .seed = seed + 2},
                  .side_wall = {.color = FromSrgb(0xC9C2B2), .grain = 0.12F, .grain_size_m = 0.5F, .seed = seed + 3}});
  // A wall that is painted almost evenly: the untextured part.
  AddProp(scene, "panel", MakeBox(1.5, 0.05, 1.9), At(-0.3, 4.5, 1.05),
          {.color = FromSrgb(0x8FA9B8), .grain = 0.05F, .grain_size_m = 0.4F, .seed = seed + 4});
  AddProp(scene, "poster", MakeBox(0.8, 0.02, 1.1), At(1.55, 4.57, 1.5),
          {.pattern = Pattern::kMosaic,
           .color = FromSrgb(0xF0F0F0),
           .pattern_size_m = 0.16F,
           .grain = 0.15F,
           .seed = seed + 5});

  const int boxes = scene.AddBody("boxes");
  const Paint carton{.color = FromSrgb(0xB58A5A), .grain = 0.35F, .grain_size_m = 0.10F, .seed = seed + 6};
  const Paint crate{.pattern = Pattern::kStripes,
                    .color = FromSrgb(0x9C7748),
                    .second_color = FromSrgb(0x5E4526),
                    .pattern_size_m = 0.10F,
                    .grain = 0.4F,
                    .grain_size_m = 0.08F,
                    .seed = seed + 7};
  const Paint blue_box{.pattern = Pattern::kChecks,
                       .color = FromSrgb(0x35608F),
                       .second_color = FromSrgb(0x284668),
                       .pattern_size_m = 0.09F,
                       .grain = 0.25F,
                       .seed = seed + 8};
  scene.AddPart(boxes, MakeBox(0.55, 0.5, 0.45), At(0.95, 2.35, 0.225) * Turn(Vec3::UnitZ(), 0.35), carton);
  scene.AddPart(boxes, MakeBox(0.40, 0.4, 0.38), At(0.92, 2.38, 0.64) * Turn(Vec3::UnitZ(), -0.2), crate);
  scene.AddPart(boxes, MakeBox(0.45, 0.45, 0.6), At(-1.45, 3.2, 0.3) * Turn(Vec3::UnitZ(), 0.5), blue_box);
  scene.AddPart(boxes, MakeBox(0.7, 0.5, 0.35), At(1.75, 3.7, 0.175) * Turn(Vec3::UnitZ(), -0.3), blue_box);
  scene.AddPart(boxes, MakeBox(0.5, 0.4, 0.4), At(1.72, 3.72, 0.55) * Turn(Vec3::UnitZ(), 0.1), carton);
  const int lamp = scene.AddBody("floor lamp");
  const Paint steel{.color = FromSrgb(0x50545A), .grain = 0.15F, .seed = seed + 9};
  AddRod(scene, lamp, {-2.0, 3.9, 0.0}, {-2.0, 3.9, 1.75}, 0.018, steel);
  scene.AddPart(lamp, MakeCylinder(0.16, 0.02), At(-2.0, 3.9, 0.01), steel);
  scene.AddPart(lamp, MakeLimb(0.22, 0.20, 0.11), At(-2.0, 3.9, 1.62),
                {.color = FromSrgb(0xE6D9A8), .grain = 0.1F, .seed = seed + 10});

  // The first touch comes 0.05 s into the clip.
  const Bounce gym{.radius = 0.30, .impact_speed = 4.4, .squash = 0.085, .phase = -0.05};
  const int gym_ball = scene.AddBody("gym ball", [gym](double t) {
    const double x = -0.55 + 0.75 * std::sin(2.6 * t - 0.3);
    return gym.Place(t, x, 2.35, Turn(Vec3(0.2, 1, 0.1).normalized(), 3.0 * t));
  });
  scene.AddPart(gym_ball, MakeBall(gym.radius), Affine::Identity(),
                {.pattern = Pattern::kStripes,
                 .color = FromSrgb(0xD0402E),
                 .second_color = FromSrgb(0xE9B83B),
                 .pattern_size_m = 0.19F,
                 .grain = 0.35F,
                 .grain_size_m = 0.10F,
                 .seed = seed + 11});

  // Flies through behind the near boxes and in front of the far ones.
  const Bounce football{.radius = 0.15, .impact_speed = 3.9, .squash = 0.03, .phase = 0.30};
  const int soccer = scene.AddBody("football", [football](double t) {
    const double x = 0.55 + 1.25 * std::sin(6.5 * t + 0.15);
    return football.Place(t, x, 3.0, Turn(Vec3(0.3, 1, -0.4).normalized(), 9.0 * t));
  });
  scene.AddPart(soccer, MakeBall(football.radius), Affine::Identity(),
                {.pattern = Pattern::kPatches,
                 .color = FromSrgb(0xECECE6),
                 .second_color = FromSrgb(0x26282C),
                 .grain = 0.25F,
                 .grain_size_m = 0.06F,
                 .seed = seed + 12});

  const Bounce tennis{.radius = 0.07, .impact_speed = 5.0, .squash = 0.02, .phase = 0.62};
  const int tennis_ball = scene.AddBody("tennis ball", [tennis](double t) {
    const double x = 0.15 + 0.95 * std::sin(5.6 * t + 2.4);
    return tennis.Place(t, x, 1.75, Turn(Vec3(1, 0.5, 0).normalized(), 12.0 * t));
  });
  scene.AddPart(tennis_ball, MakeBall(tennis.radius), Affine::Identity(),
                {.color = FromSrgb(0xC8D940), .grain = 0.5F, .grain_size_m = 0.05F, .seed = seed + 13});

  // A racket: a ring of short rods, strings, and a handle, swung from the lower right.
  const int racket = scene.AddBody("racket", [](double t) {
    const double swing = 0.9 * std::sin(9.0 * t - 0.75);
    return At(1.05, 1.75, 0.62) * Turn(Vec3::UnitY(), -0.65 + swing) * Turn(Vec3::UnitZ(), 0.4);
  });
  const Paint frame{.pattern = Pattern::kStripes,
                    .color = FromSrgb(0x2D6E4E),
                    .second_color = FromSrgb(0xE8E8E0),
                    .pattern_size_m = 0.12F,
                    .grain = 0.3F,
                    .grain_size_m = 0.05F,
                    .seed = seed + 14};
  const auto rim = [](int i) {
    const double angle = 2 * kPi * i / 14;
    return Vec3(0.125 * std::sin(angle), 0, 0.47 - 0.165 * std::cos(angle));
  };
  for (int i = 0; i < 14; ++i) AddRod(scene, racket, rim(i), rim(i + 1), 0.013, frame);
  AddRod(scene, racket, {0, 0, 0}, {0, 0, 0.31}, 0.018, frame);
  const Paint strings{.color = FromSrgb(0xD8D4C4), .grain = 0.1F, .seed = seed + 15};
  for (int i = -1; i <= 1; ++i) {
    AddRod(scene, racket, {0.055 * i, 0, 0.33}, {0.055 * i, 0, 0.61}, 0.005, strings);
    AddRod(scene, racket, {-0.11, 0, 0.47 + 0.075 * i}, {0.11, 0, 0.47 + 0.075 * i}, 0.005, strings);
  }

  scene.SetCamera([](double) { return LookAt({0.05, -0.1, 1.15}, {0.05, 3.0, 0.72}); });
}

void BuildStill(Scene& scene, uint64_t seed) {
  // The bouncing scene with its clock stopped while the large ball is pressed to the floor.
  Scene bounce("bounce");
  BuildBounce(bounce, seed);
  const double moment = 0.07;
  for (const Body& body : bounce.bodies()) scene.AddBody(body.name);
  for (const Part& part : bounce.parts())
    scene.AddPart(part.body, part.shape, bounce.bodies()[part.body].motion(moment) * part.body_from_part, part.paint,
                  part.casts_shadow);
  for (const Scene::Lamp& lamp : bounce.lamps()) scene.AddLamp(lamp.position, lamp.strength);
  const Pose pose = bounce.WorldFromCamera(moment);
  scene.SetCamera([pose](double) { return pose; });
}

}  // namespace depthtween
