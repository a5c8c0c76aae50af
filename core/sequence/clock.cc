#include "core/sequence/clock.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace depthtween {
namespace {

double Median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

int64_t StampJitterNs(const std::vector<FrameRef>& frames) {
  if (frames.size() < 4) return 0;
  std::vector<double> gaps;
  for (size_t i = 1; i < frames.size(); ++i)
    gaps.push_back(static_cast<double>(frames[i].time_ns - frames[i - 1].time_ns));
  std::vector<double> sorted = gaps;
  const double period = Median(sorted);
  for (double& gap : gaps) gap = std::abs(gap - period * std::max(1.0, std::round(gap / period)));
  // A gap is the difference of two stamps: its deviation is sqrt(2) times one stamp's. 1.4826: median to standard
  // deviation.
  return static_cast<int64_t>(1.4826 / std::sqrt(2.0) * Median(gaps));
}

}  // namespace depthtween
