// How much memory tasks may use on this machine.
#ifndef DEPTHTWEEN_SERVER_JOBS_MACHINE_MEMORY_H_
#define DEPTHTWEEN_SERVER_JOBS_MACHINE_MEMORY_H_

#include <cstdint>
#include <string>

namespace depthtween::server {

// What the machine has, or what the control group of this process (version 2 or 1) or one above it is limited to, if
// that is less; bytes. 0 if /proc does not tell. `root` is put before all paths that are read.
int64_t UsableMemoryBytes(const std::string& root = "");

// The share of one task: 0.8 of it, divided by the workers. At least 1 GiB, as a limit counts what a task maps, whether
// or not it touches it. 0, which is no limit, when it is not known how much there is.
int64_t TaskMemoryBytes(int64_t usable_bytes, int workers);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_MACHINE_MEMORY_H_
