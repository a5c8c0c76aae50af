#include "core/solve/time_basis.h"

#include <cassert>
#include <cmath>

namespace depthtween {

TimeBasis TimeBasis::Trajectory(const std::vector<float>& times) {
  assert(!times.empty());
  const int frames = static_cast<int>(times.size());
  std::vector<double> velocity(frames), bend(frames);
  double length = 0;
  for (int s = 0; s < frames; ++s) length += static_cast<double>(times[s]) * times[s];
  length = std::sqrt(length);
  double along = 0;
  for (int s = 0; s < frames; ++s) {
    velocity[s] = times[s] / length;
    bend[s] = static_cast<double>(times[s]) * (times[s] - 1.0);
    along += velocity[s] * bend[s];
  }
  double rest = 0;
  for (int s = 0; s < frames; ++s) bend[s] -= along * velocity[s], rest += bend[s] * bend[s];
  rest = std::sqrt(rest);
  // With one frame, or frames so close that they tell no acceleration, what is left is rounding.
  const bool bends = frames > 1 && rest > 1e-4 * length;
  TimeBasis basis(frames, bends ? 2 : 1, false);
  for (int s = 0; s < frames; ++s) {
    basis.value_[s * basis.rank_] = static_cast<float>(velocity[s]);
    if (bends) basis.value_[s * basis.rank_ + 1] = static_cast<float>(bend[s] / rest);
  }
  return basis;
}

TimeBasis TimeBasis::PerFrame(int frames) {
  assert(frames > 0);
  TimeBasis basis(frames, frames, true);
  for (int s = 0; s < frames; ++s) basis.value_[s * frames + s] = 1.0F;
  return basis;
}

}  // namespace depthtween
