// Whether the server can do its work at all: tries, again and again, to write to the folder of tasks and to the
// database.
//
// A disk that has become read-only, one that reports errors, and a damaged database mean NOT_SERVING, with an error in
// the log; so does a database in which the scrub has found damage. A full disk does not: results are still read, and
// deleted to make room.
#ifndef DEPTHTWEEN_SERVER_JOBS_HEALTH_PROBE_H_
#define DEPTHTWEEN_SERVER_JOBS_HEALTH_PROBE_H_

#include <thread>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/jobs/damage_log.h"
#include "server/store/data_directory.h"
#include "server/store/store.h"
#include "server/telemetry/health.h"

namespace depthtween::server {

// One try. OK, or what is broken: Internal, PermissionDenied or DataLoss.
absl::Status ProbeDisk(Store& store, const DataDirectory& directory, const DamageLog& damage);

// Tries at once, and every `gap`, on a thread of its own from its creation to its destruction. Borrows all.
class HealthProbe {
 public:
  HealthProbe(Store& store, const DataDirectory& directory, const DamageLog& damage, Health& health,
              absl::Duration gap = absl::Seconds(10));

 private:
  void Work(const std::stop_token& stop);

  Store& store_;
  const DataDirectory& directory_;
  const DamageLog& damage_;
  Health& health_;
  const absl::Duration gap_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_HEALTH_PROBE_H_
