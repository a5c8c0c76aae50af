#include "core/base/parallel.h"

#include <sched.h>

#include <algorithm>
#include <thread>

#include "tbb/parallel_for.h"
#include "tbb/task_arena.h"

namespace depthtween {

void ParallelFor(int count, int threads, const std::function<void(int)>& body) {
  if (threads <= 1 || count <= 1) {
    for (int i = 0; i < count; ++i) body(i);
    return;
  }
  tbb::task_arena arena(threads);
  arena.execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<int>(0, count, 1),
        [&](const tbb::blocked_range<int>& range) {
          for (int i = range.begin(); i != range.end(); ++i) body(i);
        },
        tbb::simple_partitioner());
  });
}

void ParallelRows(int height, int threads, const std::function<void(int, int)>& body, int band) {
  const int bands = (height + band - 1) / band;
  ParallelFor(bands, threads, [&](int i) { body(i * band, std::min(height, (i + 1) * band)); });
}

int AvailableThreads() {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (sched_getaffinity(0, sizeof(set), &set) == 0) return std::max(1, CPU_COUNT(&set));
  return std::max(1U, std::thread::hardware_concurrency());
}

}  // namespace depthtween
