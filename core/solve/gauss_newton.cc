#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/solve/coarse_space.h"
#include "core/solve/solve.h"

namespace depthtween {
namespace {

// A Newton step is good enough when its residual has fallen to this share. With ten times as much left three are needed
// instead of two, and what a step sets up costs more than the conjugate steps it saves.
constexpr double kForcing = 0.003;
// Points between the nodes of the coarse space, as long as it has at most so many nodes across: its band matrices cost
// the third power of those.
constexpr int kNodeSpacing = 4, kNodesAcross = 20;
// The energy is at rest when a step lowers it by less than this share.
constexpr double kRest = 1e-5;
// Far from the minimum a whole step can overshoot: kernels change, rotations are no vectors.
constexpr int kHalvings = 12;

// to += factor * from, over `count` floats.
void AddScaled(const Planes& from, float factor, size_t size, Planes& to) {
  for (int plane = 0; plane < to.count(); ++plane) {
    const float* __restrict source = from[plane];
    float* __restrict target = to[plane];
    for (size_t i = 0; i < size; ++i) target[i] += factor * source[i];
  }
}

// Solves H step = -gradient from zero. Returns the number of iterations.
int ConjugateGradient(NormalMatrix& matrix, const Preconditioner& preconditioner, CoarseSpace& coarse,
                      const Planes& gradient, int iterations, Planes& step) {
  const Grid& grid = matrix.data().grid;
  const int count = matrix.data().unknowns();
  Planes residual(grid, count), direction(grid, count), image(grid, count), better(grid, count);
  step.Clear();
  AddScaled(gradient, -1.0F, grid.size(), residual);
  const auto advance = [&](float alpha) {
    const double points = preconditioner.Apply(alpha, direction, image, step, residual, better);
    return points + coarse.Correct(residual, better);
  };
  double rz = advance(0);
  const double first = rz;
  if (!(rz > 0)) return 0;
  float carry = 0;
  for (int i = 1;; ++i) {
    const double curvature = matrix.Apply(better, carry, direction, image);
    if (!(curvature > 0)) return i;
    const double before = rz;
    const auto alpha = static_cast<float>(rz / curvature);
    if (i == iterations) return AddScaled(direction, alpha, grid.size(), step), i;  // the residual is no longer needed
    rz = advance(alpha);
    if (!(rz > kForcing * kForcing * first)) return i;
    carry = static_cast<float>(rz / before);
  }
}

}  // namespace

SolveLevelSummary Minimise(const EnergyData& data, int newton_iterations, int conjugate_iterations, Planes& unknowns,
                           std::string& termination) {
  const auto start = std::chrono::steady_clock::now();
  SolveLevelSummary summary{.width = data.grid.width, .height = data.grid.height};
  const size_t size = data.grid.size();
  Linearisation here(data);
  Planes step(data.grid, data.unknowns());
  const int across = std::min(data.grid.width, data.grid.height);
  CoarseSpace coarse(data, std::max(kNodeSpacing, (across + kNodesAcross - 1) / kNodesAcross));
  Linearise(data, unknowns, here);
  summary.first_cost = summary.last_cost = here.cost;
  termination = "schedule ended";
  for (int newton = 0; newton < newton_iterations; ++newton) {
    NormalMatrix matrix(data, unknowns, here);
    const Preconditioner preconditioner(matrix);
    coarse.Factor(matrix);
    summary.conjugate_steps +=
        ConjugateGradient(matrix, preconditioner, coarse, here.gradient, conjugate_iterations, step);
    // Half a step is the first half taken back: no second copy of the unknowns.
    float taken = 1.0F;
    AddScaled(step, taken, size, unknowns);
    Linearise(data, unknowns, here);
    for (int halving = 0; halving < kHalvings && !(here.cost < summary.last_cost); ++halving) {
      AddScaled(step, -0.5F * taken, size, unknowns);
      taken *= 0.5F;
      ++summary.refused_steps;
      Linearise(data, unknowns, here);
    }
    if (!(here.cost < summary.last_cost)) {
      AddScaled(step, -taken, size, unknowns);
      ++summary.refused_steps;
      termination = "no step lowers the cost";
      break;
    }
    ++summary.newton_steps;
    const double gain = summary.last_cost - here.cost;
    summary.last_cost = here.cost;
    if (gain <= kRest * here.cost) {
      termination = "converged";
      break;
    }
  }
  summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return summary;
}

}  // namespace depthtween
