#include "server/jobs/retention.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace depthtween::server {
namespace {

absl::Duration OrForEver(absl::Duration keep) { return keep == absl::ZeroDuration() ? absl::InfiniteDuration() : keep; }

}  // namespace

absl::Status RetentionRules::Validate() const {
  for (const auto& [field, keep] : {std::pair("keep_succeeded", keep_succeeded),
                                    {"keep_failed", keep_failed},
                                    {"keep_cancelled", keep_cancelled},
                                    {"keep_sequences", keep_sequences},
                                    {"keep_uploads", keep_uploads}}) {
    if (keep < absl::ZeroDuration()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("RetentionRules.%s = %s, must be >= 0 (0: for ever)", field, absl::FormatDuration(keep)));
    }
  }
  if (collect_below_bytes < 0 || collect_until_bytes < collect_below_bytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("RetentionRules.collect_until_bytes = %d, must be at least collect_below_bytes = %d, and both "
                        ">= 0 (0: never)",
                        collect_until_bytes, collect_below_bytes));
  }
  return absl::OkStatus();
}

absl::Duration KeepTime(const RetentionRules& rules, JobState state) {
  switch (state) {
    case JobState::kSucceeded:
      return OrForEver(rules.keep_succeeded);
    case JobState::kFailed:
      return OrForEver(rules.keep_failed);
    case JobState::kCancelled:
      return OrForEver(rules.keep_cancelled);
    case JobState::kQueued:
    case JobState::kRunning:
    case JobState::kCancelling:
      break;
  }
  return absl::InfiniteDuration();
}

absl::Time ExpireTime(const RetentionRules& rules, const JobRecord& job) {
  return job.pinned || !HasEnded(job.state) ? absl::InfiniteFuture() : job.end_time + KeepTime(rules, job.state);
}

std::string_view ToString(CollectReason reason) {
  switch (reason) {
    case CollectReason::kExpired:
      return "expired";
    case CollectReason::kAbandoned:
      return "abandoned";
    case CollectReason::kDiskPressure:
      return "disk pressure";
  }
  return "";
}

std::vector<CollectOrder> ChooseGarbage(const RetentionRules& rules, absl::Time now, int64_t free_bytes,
                                        const std::vector<Collectable>& jobs, const std::vector<Collectable>& sequences,
                                        const std::function<int64_t(const Collectable& what, bool is_job)>& bytes_of) {
  std::vector<CollectOrder> orders;
  std::vector<CollectOrder> kept;  // and old enough to go if room is needed
  const auto sort = [&](const Collectable& what, bool is_job) {
    const absl::Duration keep = is_job ? KeepTime(rules, what.job_state) : OrForEver(rules.keep_sequences);
    if (what.since + keep <= now) {
      orders.push_back({.what = what, .is_job = is_job, .bytes = bytes_of(what, is_job)});
      free_bytes += orders.back().bytes;
    } else if (what.since + kLeastKeep <= now) {
      kept.push_back({.what = what, .is_job = is_job, .reason = CollectReason::kDiskPressure});
    }
  };
  for (const Collectable& job : jobs) sort(job, /*is_job=*/true);
  for (const Collectable& sequence : sequences) sort(sequence, /*is_job=*/false);
  if (free_bytes >= rules.collect_below_bytes) return orders;
  std::stable_sort(kept.begin(), kept.end(),
                   [](const CollectOrder& a, const CollectOrder& b) { return a.what.since < b.what.since; });
  for (CollectOrder& order : kept) {
    if (free_bytes >= rules.collect_until_bytes) break;
    order.bytes = bytes_of(order.what, order.is_job);
    if (order.bytes == 0) continue;  // makes no room
    free_bytes += order.bytes;
    orders.push_back(order);
  }
  return orders;
}

}  // namespace depthtween::server
