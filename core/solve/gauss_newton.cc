#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/solve/solve.h"

namespace depthtween {
namespace {

// A Newton step is good enough when its residual has fallen to this share.
constexpr double kForcing = 0.03;
// The energy is at rest when a step lowers it by less than this share.
constexpr double kRest = 1e-5;
// The matrix takes rotations of edges at rest, so far from the minimum a whole step can overshoot by far; with two
// halvings the minimiser stopped at 50 times the least cost (tests/core/solve/ceres_test.cc).
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
int ConjugateGradient(const EnergyData& data, const Linearisation& at, const Preconditioner& preconditioner,
                      int iterations, Planes& step) {
  const Grid& grid = data.grid;
  const size_t size = grid.size();
  const int count = data.unknowns();
  Planes residual(grid, count), direction(grid, count), image(grid, count), better(grid, count);
  step.Clear();
  AddScaled(at.gradient, -1.0F, size, residual);
  double rz = preconditioner.Apply(data, residual, better);
  const double first = rz;
  if (!(rz > 0)) return 0;
  for (int plane = 0; plane < count; ++plane) std::copy_n(better[plane], size, direction[plane]);
  for (int i = 1;; ++i) {
    const double curvature = ApplyNormalMatrix(data, at.blocks, direction, image);
    if (!(curvature > 0)) return i;
    const auto alpha = static_cast<float>(rz / curvature);
    AddScaled(direction, alpha, size, step);
    if (i == iterations) return i;
    AddScaled(image, -alpha, size, residual);
    const double rz_before = rz;
    rz = preconditioner.Apply(data, residual, better);
    if (!(rz > kForcing * kForcing * first)) return i;
    const auto beta = static_cast<float>(rz / rz_before);
    for (int plane = 0; plane < count; ++plane) {
      const float* __restrict source = better[plane];
      float* __restrict target = direction[plane];
      for (size_t k = 0; k < size; ++k) target[k] = source[k] + beta * target[k];
    }
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
  Linearise(data, unknowns, here);
  summary.first_cost = summary.last_cost = here.cost;
  termination = "schedule ended";
  for (int newton = 0; newton < newton_iterations; ++newton) {
    const Preconditioner preconditioner(data, here.blocks);
    summary.conjugate_steps += ConjugateGradient(data, here, preconditioner, conjugate_iterations, step);
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
