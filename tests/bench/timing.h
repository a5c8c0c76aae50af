// How benchmarks take time.
#ifndef DEPTHTWEEN_TESTS_BENCH_TIMING_H_
#define DEPTHTWEEN_TESTS_BENCH_TIMING_H_

#include <algorithm>
#include <chrono>
#include <vector>

namespace depthtween {

// Wall seconds that body() takes.
template <typename Body>
double Seconds(const Body& body) {
  const auto start = std::chrono::steady_clock::now();
  body();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// The upper one of the two in the middle. Not of nothing.
inline double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_BENCH_TIMING_H_
