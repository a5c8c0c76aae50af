// Deletes what the rules of retention.h let it delete.
#ifndef DEPTHTWEEN_SERVER_JOBS_COLLECTOR_H_
#define DEPTHTWEEN_SERVER_JOBS_COLLECTOR_H_

#include <mutex>
#include <vector>

#include "core/base/status.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/retention.h"
#include "server/jobs/sequences.h"
#include "server/store/data_directory.h"
#include "server/store/store.h"

namespace depthtween::server {

// Threads: may be called concurrently; one collection waits for the other.
class Collector {
 public:
  // Borrows all but the rules.
  Collector(Store& store, JobManager& jobs, Sequences& sequences, const DataDirectory& directory,
            const RetentionRules& rules)
      : store_(store), jobs_(jobs), sequences_(sequences), directory_(directory), rules_(rules) {}

  const RetentionRules& rules() const { return rules_; }

  // What was deleted, with a line in the log for each; with `dry_run`, what would be. What cannot be deleted is logged
  // and left out, and so is what somebody has pinned or used in the meantime. Errors: those of the store's lists.
  absl::StatusOr<std::vector<Collected>> Collect(bool dry_run);

 private:
  absl::Status Delete(const CollectOrder& order);

  Store& store_;
  JobManager& jobs_;
  Sequences& sequences_;
  const DataDirectory& directory_;
  const RetentionRules rules_;
  std::mutex one_at_a_time_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_COLLECTOR_H_
