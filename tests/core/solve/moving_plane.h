// A slanted plane that turns and travels: tracks, flow, colours and depth of every frame follow from its pose, exactly.
#ifndef DEPTHTWEEN_TESTS_CORE_SOLVE_MOVING_PLANE_H_
#define DEPTHTWEEN_TESTS_CORE_SOLVE_MOVING_PLANE_H_

#include <cmath>
#include <vector>

#include "core/solve/solve.h"

namespace depthtween {

struct MovingPlaneOptions {
  int width = 48, height = 40, frames = 4, step = 2;
  double metres = 1.0;                      // the whole world is this much larger
  double turn[3] = {0.05, -0.08, 0.12};     // radians until the other key
  double travel[3] = {0.06, -0.03, -0.10};  // metres until then
  double bend_m = 0.0;                      // t (t - 1) bend_m is added to the travel along x: acceleration
};

class MovingPlane {
 public:
  explicit MovingPlane(const MovingPlaneOptions& options) : options_(options) {
    camera_ = {.width = options.width, .height = options.height, .fx = 60, .fy = 60, .cx = 23.5, .cy = 19.5};
    const int count = options.frames + 1;
    for (int s = 0; s < count; ++s) {
      depth_.emplace_back(options.width, options.height);
      color_.emplace_back(options.width, options.height);
      luma_.emplace_back(options.width, options.height);
      forward_.emplace_back(options.width, options.height);
      back_.emplace_back(options.width, options.height);
      tracks_.emplace_back((options.width + options.step - 1) / options.step,
                           (options.height + options.step - 1) / options.step);
      for (int y = 0; y < options.height; ++y)
        for (int x = 0; x < options.width; ++x) {
          const Triple<double> p = Seen(s, x, y);
          depth_[s](x, y) = static_cast<float>(p.z);
          const Triple<double> rest = ToRest(s, p);
          const double wave = std::sin(9 * rest.x / options.metres) * std::cos(7 * rest.y / options.metres);
          const auto value = static_cast<uint8_t>(std::lround(127 + 90 * wave));
          color_[s](x, y) = {value, value, value};
          luma_[s](x, y) = value;
          if (s + 1 < count) forward_[s](x, y) = Motion(s, s + 1, x, y);
          if (s > 0) back_[s](x, y) = Motion(s, s - 1, x, y);
        }
      for (int j = 0; j < tracks_[s].height(); ++j)
        for (int i = 0; i < tracks_[s].width(); ++i)
          tracks_[s](i, j) = Motion(0, s, i * options.step, j * options.step);
    }
  }

  double Time(int s) const { return static_cast<double>(s) / options_.frames; }
  const Camera& camera() const { return camera_; }
  Image<Flow2>& track(int s) { return tracks_[s]; }
  Image<float>& depth(int s) { return depth_[s]; }

  SolveProblem Problem() const {
    const auto scale = static_cast<float>(options_.metres);
    SolveProblem problem{.camera = camera_,
                         .step = options_.step,
                         .key = {depth_.front(), color_.front(), luma_.front()},
                         .other = {depth_.back(), color_.back(), luma_.back()},
                         // a + b z^2 of a world m times as large: m a + (b/m) (m z)^2.
                         .noise = {.a_m = 0.001F * scale, .b_per_m = 0.0004F / scale}};
    for (int s = 1; s <= options_.frames; ++s)
      problem.frames.push_back({static_cast<float>(Time(s)), luma_[s], tracks_[s], forward_[s - 1], back_[s]});
    return problem;
  }

  // Where the point that the key sees at a pixel is in frame s.
  Triple<double> PointAt(int s, double x, double y) const { return FromRest(s, ToRest(0, Seen(0, x, y))); }

 private:
  // The plane z = 2 + 0.3 x - 0.2 y (metres), moved about a point on it.
  Triple<double> Centre() const { return {0, 0, 2 * options_.metres}; }
  Rotation<double> Turn(int s) const {
    const double t = Time(s);
    return RotationOf(Triple<double>{t * options_.turn[0], t * options_.turn[1], t * options_.turn[2]});
  }
  Triple<double> Travel(int s) const {
    const double t = Time(s), m = options_.metres;
    return {m * (t * options_.travel[0] + t * (t - 1) * options_.bend_m), m * t * options_.travel[1],
            m * t * options_.travel[2]};
  }
  Triple<double> FromRest(int s, const Triple<double>& p) const {
    return Turn(s) * (p - Centre()) + Centre() + Travel(s);
  }
  Triple<double> ToRest(int s, const Triple<double>& p) const {
    const Rotation<double> r = Turn(s);
    const Triple<double> q = p - Centre() - Travel(s);
    return Triple<double>{r.row[0].x * q.x + r.row[1].x * q.y + r.row[2].x * q.z,
                          r.row[0].y * q.x + r.row[1].y * q.y + r.row[2].y * q.z,
                          r.row[0].z * q.x + r.row[1].z * q.y + r.row[2].z * q.z} +
           Centre();
  }
  Triple<double> Seen(int s, double x, double y) const {
    const Triple<double> ray{(x - camera_.cx) / camera_.fx, (y - camera_.cy) / camera_.fy, 1};
    // n . (rest(p)) = n . centre with n = (0.3, -0.2, -1); rest is affine along the ray.
    const Triple<double> n{0.3, -0.2, -1};
    const double at0 = Dot(n, ToRest(s, {0, 0, 0}) - Centre()), at1 = Dot(n, ToRest(s, ray) - Centre());
    return (-at0 / (at1 - at0)) * ray;
  }
  Flow2 Motion(int from, int to, double x, double y) const {
    const Triple<double> p = FromRest(to, ToRest(from, Seen(from, x, y)));
    return {static_cast<float>(camera_.fx * p.x / p.z + camera_.cx - x),
            static_cast<float>(camera_.fy * p.y / p.z + camera_.cy - y)};
  }

  MovingPlaneOptions options_;
  Camera camera_;
  std::vector<Image<float>> depth_;
  std::vector<Image<Rgb8>> color_;
  std::vector<Image<uint8_t>> luma_;
  std::vector<Image<Flow2>> forward_, back_, tracks_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_SOLVE_MOVING_PLANE_H_
