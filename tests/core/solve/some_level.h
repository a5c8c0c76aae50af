// Energies of a moving plane to try the minimiser on.
#ifndef DEPTHTWEEN_TESTS_CORE_SOLVE_SOME_LEVEL_H_
#define DEPTHTWEEN_TESTS_CORE_SOLVE_SOME_LEVEL_H_

#include <random>
#include <utility>

#include "core/solve/level.h"
#include "tests/core/solve/moving_plane.h"

namespace depthtween {

// The finest level, started from its tracks and associated once.
inline Level SomeLevel(const MovingPlane& plane, const SolveOptions& options, Planes& unknowns) {
  const SolveProblem problem = plane.Problem();
  const IdealPixels pixels(problem.camera);
  const PartnerSurface other{problem.other.depth_m, problem.other.color, &pixels, problem.noise, problem.step};
  const Evidence evidence = GatherEvidence(problem, options, pixels);
  Level level =
      MakeLevel(problem, options, pixels, evidence, std::move(DecimatePoints(evidence, problem.noise, 1)[0]), 1);
  unknowns = Planes(level.data.grid, level.data.unknowns());
  StartFromTracks(problem, evidence, other, level, unknowns);
  Associate(problem, options, pixels, evidence, other, unknowns, level);
  return level;
}

// The plane turns, travels, accelerates; some of its tracks are wrong, so that kernels matter, and each coefficient of
// the start is off by `start_off` (metres, radians).
inline Level HardLevel(const SolveOptions& options, float start_off, Planes& unknowns, int points_x = 13,
                       int points_y = 11) {
  MovingPlane plane({.width = 2 * points_x, .height = 2 * points_y, .bend_m = 0.05});
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  for (int s = 1; s <= 4; ++s)
    for (size_t p = 0; p < plane.track(s).pixel_count(); ++p) {
      Flow2& track = plane.track(s).data()[p];
      const float off = p % 11 == 0 ? 4.0F : 0.2F;
      track = {track.u + off * normal(random), track.v + off * normal(random)};
    }
  Level level = SomeLevel(plane, options, unknowns);
  const Grid& grid = level.data.grid;
  for (int k = 0; k < level.data.unknowns(); ++k)
    for (int j = 0; j < grid.height; ++j)
      for (int i = 0; i < grid.width; ++i) unknowns[k][grid.at(i, j)] += start_off * normal(random);
  return level;
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_SOLVE_SOME_LEVEL_H_
