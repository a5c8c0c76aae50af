// Loops over independent items on a bounded number of threads.
//
// Results must not depend on the number of threads: an item writes only what is its own, and sums are added in item
// order by the caller afterwards.
#ifndef DEPTHTWEEN_CORE_BASE_PARALLEL_H_
#define DEPTHTWEEN_CORE_BASE_PARALLEL_H_

#include <functional>

namespace depthtween {

// Calls body(i) for every i in [0, count), at most `threads` at a time (>= 1), in any order. Returns when all are done.
// An exception in a body is thrown on to the caller. `threads` == 1 runs in order on the calling thread.
void ParallelFor(int count, int threads, const std::function<void(int)>& body);

// Calls body(first_row, last_row_exclusive) on bands of at most `band` rows.
void ParallelRows(int height, int threads, const std::function<void(int, int)>& body, int band = 16);

// The processors this process may use: the default of every --threads option.
int AvailableThreads();

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_PARALLEL_H_
