// What the server may delete by itself, and when.
//
// Only what has ended or is not used, and is not pinned: a job by how long ago it ended, a recording by how long no job
// has used it, an upload by how long no byte of it has come. And when the disk is nearly full, the oldest of them until
// there is room. All of it is off unless the operator asks for it, but for abandoned uploads.
#ifndef DEPTHTWEEN_SERVER_JOBS_RETENTION_H_
#define DEPTHTWEEN_SERVER_JOBS_RETENTION_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/store/records.h"

namespace depthtween::server {

// Zero: for ever.
struct RetentionRules {
  absl::Duration keep_succeeded;
  absl::Duration keep_failed;
  absl::Duration keep_cancelled;
  absl::Duration keep_sequences;  // since a job has used it
  absl::Duration keep_uploads;    // while UPLOADING, since a byte came
  // Collecting begins when less is free, and ends when as much is; 0: never.
  int64_t collect_below_bytes = 0;
  int64_t collect_until_bytes = 0;

  // InvalidArgument with the field, its value and the rule.
  absl::Status Validate() const;
};

// However full the disk is: who has waited for a result gets the time to fetch it.
inline constexpr absl::Duration kLeastKeep = absl::Hours(1);

// How long a job in this state is kept; infinite for ever, and for one that has not ended.
absl::Duration KeepTime(const RetentionRules& rules, JobState state);
// When this job may be collected for its age; InfiniteFuture: never.
absl::Time ExpireTime(const RetentionRules& rules, const JobRecord& job);

enum class CollectReason { kExpired, kAbandoned, kDiskPressure };
std::string_view ToString(CollectReason reason);

struct Collected {
  std::string resource;  // "jobs/ID" or "sequences/ID"
  std::string tenant;
  CollectReason reason = CollectReason::kExpired;
  absl::Time since;
  int64_t bytes = 0;
};

// One thing to delete, as it was when it was listed.
struct CollectOrder {
  Collectable what;
  bool is_job = false;
  CollectReason reason = CollectReason::kExpired;
  int64_t bytes = 0;
};

// What the rules say of these lists, in the order in which to delete it: what has expired, then, while `free_bytes` and
// what has been freed so far come to less than the rules ask for, the oldest of all. Lists are in the order of `since`.
// `bytes_of` gives the bytes of one of them.
std::vector<CollectOrder> ChooseGarbage(const RetentionRules& rules, absl::Time now, int64_t free_bytes,
                                        const std::vector<Collectable>& jobs, const std::vector<Collectable>& sequences,
                                        const std::function<int64_t(const Collectable& what, bool is_job)>& bytes_of);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_RETENTION_H_
