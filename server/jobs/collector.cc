#include "server/jobs/collector.h"

#include <limits>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "server/telemetry/log.h"

namespace depthtween::server {

absl::Status Collector::Delete(const CollectOrder& order) {
  if (order.reason == CollectReason::kAbandoned) return sequences_.RemoveAbandoned(order.what);
  return order.is_job ? jobs_.Collect(order.what) : sequences_.Collect(order.what);
}

absl::StatusOr<std::vector<Collected>> Collector::Collect(bool dry_run) {
  const std::lock_guard lock(one_at_a_time_);
  const absl::Time now = absl::Now();
  std::vector<CollectOrder> orders;
  if (rules_.keep_uploads > absl::ZeroDuration()) {
    ASSIGN_OR_RETURN(const std::vector<Collectable> abandoned, store_.AbandonedSequences(now - rules_.keep_uploads));
    for (const Collectable& sequence : abandoned) {
      orders.push_back({.what = sequence,
                        .reason = CollectReason::kAbandoned,
                        .bytes = store_.BytesOfSequence(sequence.id).value_or(0)});
    }
  }
  ASSIGN_OR_RETURN(const std::vector<Collectable> jobs, store_.CollectableJobs());
  ASSIGN_OR_RETURN(const std::vector<Collectable> sequences, store_.CollectableSequences());
  // Where it is not known how much is free, none is deleted for it.
  const int64_t free_bytes = directory_.FreeBytes().value_or(std::numeric_limits<int64_t>::max() / 2);
  const std::vector<CollectOrder> others =
      ChooseGarbage(rules_, now, free_bytes, jobs, sequences, [this](const Collectable& what, bool is_job) {
        return (is_job ? store_.BytesOfJob(what.id) : store_.BytesOfSequence(what.id)).value_or(0);
      });
  orders.insert(orders.end(), others.begin(), others.end());

  std::vector<Collected> collected;
  for (const CollectOrder& order : orders) {
    const std::string resource = absl::StrCat(order.is_job ? "jobs/" : "sequences/", order.what.id);
    if (!dry_run) {
      const absl::Status deleted = Delete(order);
      if (absl::IsFailedPrecondition(deleted) || absl::IsNotFound(deleted)) continue;  // it is used again, or gone
      if (!deleted.ok()) {
        LogWarning("cannot collect", {{"resource", resource}, {"error", std::string(deleted.message())}});
        continue;
      }
      LogInfo("collected", {{"resource", resource},
                            {"tenant", order.what.tenant},
                            {"reason", std::string(ToString(order.reason))},
                            {"since", absl::FormatTime(order.what.since, absl::UTCTimeZone())},
                            {"bytes", absl::StrCat(order.bytes)}});
    }
    collected.push_back({.resource = resource,
                         .tenant = order.what.tenant,
                         .reason = order.reason,
                         .since = order.what.since,
                         .bytes = order.bytes});
  }
  return collected;
}

}  // namespace depthtween::server
