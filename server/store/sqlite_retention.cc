// Time limits of jobs, and what may be deleted to make room.
#include "absl/strings/str_format.h"
#include "server/store/error_info.h"
#include "server/store/sqlite_store_impl.h"

namespace depthtween::server {
namespace {

// The shorter of a job's limit and the server's, ?1 and ?2; 0 where neither has one.
constexpr char kOverdue[] =
    "WITH due AS (SELECT number, id, state, "
    "  CASE state WHEN 1 THEN queue_time_us ELSE start_time_us END AS since, "
    "  CASE state WHEN 1 THEN min(ifnull(nullif(queue_limit_us, 0), ?1), ifnull(nullif(?1, 0), queue_limit_us)) "
    "             ELSE min(ifnull(nullif(run_limit_us, 0), ?2), ifnull(nullif(?2, 0), run_limit_us)) END AS allowed "
    "  FROM jobs WHERE state IN (1, 2)) "
    "SELECT number, id, state, allowed FROM due WHERE allowed > 0 AND since + allowed <= ?3 ORDER BY number";

// A recording was last used when the last job on it ended.
constexpr char kUnusedSequences[] =
    "SELECT id, tenant, max(update_time_us, ifnull((SELECT max(j.end_time_us) FROM jobs j WHERE j.sequence_id = s.id), "
    "0)) AS since FROM sequences s WHERE state IN (3, 4) AND pinned = 0 AND (?1 IS NULL OR id = ?1) "
    "AND NOT EXISTS (SELECT 1 FROM jobs j WHERE j.sequence_id = s.id AND j.state IN (1, 2, 3)) ORDER BY since, number";

// A job that is not finished may still take the depth of another.
constexpr char kEndedJobs[] =
    "SELECT id, tenant, end_time_us, state FROM jobs j WHERE state IN (4, 5, 6) AND pinned = 0 "
    "AND (?1 IS NULL OR id = ?1) AND NOT EXISTS (SELECT 1 FROM jobs o WHERE o.state IN (1, 2, 3) AND o.depth_from = "
    "j.id) ORDER BY end_time_us, number";

// Uploads of which nothing has come since ?1; of all, or ?2 alone.
constexpr char kAbandoned[] =
    "SELECT id, tenant, max(update_time_us, ifnull((SELECT max(u.progress_time_us) FROM uploads u WHERE u.sequence = "
    "s.number), 0)) AS since, number FROM sequences s WHERE state = 1 AND pinned = 0 AND (?2 IS NULL OR id = ?2) "
    "AND since < ?1 ORDER BY since, number";

Collectable ToCollectable(const SqlRow& row) {
  return {.id = row.Text(0), .tenant = row.Text(1), .since = absl::FromUnixMicros(row.Int64(2))};
}

Collectable ToEndedJob(const SqlRow& row) {
  Collectable job = ToCollectable(row);
  job.job_state = static_cast<JobState>(row.Int(3));
  return job;
}

absl::Status NoLongerCollectable(std::string_view name) {
  return WrongState("IN_USE", absl::StrCat(std::string(name), " has been pinned, used or deleted meanwhile"));
}

}  // namespace

absl::StatusOr<std::vector<std::string>> SqliteStore::FailOverdueJobs(const TimeLimits& server) {
  struct Overdue {
    int64_t number;
    std::string id;
    bool waits;
    absl::Duration allowed;
  };
  const auto overdue = [&]() -> absl::StatusOr<std::vector<Overdue>> {
    std::vector<Overdue> jobs;
    RETURN_IF_ERROR(database_->Run(kOverdue,
                                   {absl::ToInt64Microseconds(server.queue), absl::ToInt64Microseconds(server.run),
                                    absl::ToUnixMicros(absl::Now())},
                                   [&jobs](const SqlRow& row) {
                                     jobs.push_back({.number = row.Int64(0),
                                                     .id = row.Text(1),
                                                     .waits = static_cast<JobState>(row.Int(2)) == JobState::kQueued,
                                                     .allowed = absl::Microseconds(row.Int64(3))});
                                   }));
    return jobs;
  };
  // Nearly always there is none, and then nothing is to be written.
  ASSIGN_OR_RETURN(const std::vector<Overdue> seen, Read(overdue));
  if (seen.empty()) return std::vector<std::string>();
  return Transact([&]() -> absl::StatusOr<std::vector<std::string>> {
    ASSIGN_OR_RETURN(const std::vector<Overdue> jobs, overdue());
    std::vector<std::string> failed;
    for (const Overdue& job : jobs) {
      const std::string limit = job.waits ? "queue_time_limit" : "run_time_limit";
      const std::string text = absl::StrFormat(
          "the job has %s for %s, which is its %s; retry it when the server has more time, or create "
          "it with a longer limit",
          job.waits ? "waited in the queue" : "run", absl::FormatDuration(job.allowed), limit);
      RETURN_IF_ERROR(FailJob(
          job.number, WithErrorInfo(absl::DeadlineExceededError(text),
                                    {.reason = "TIME_LIMIT",
                                     .metadata = {{"limit", limit},
                                                  {"seconds", absl::StrCat(absl::ToDoubleSeconds(job.allowed))}}})));
      failed.push_back(job.id);
    }
    return failed;
  });
}

absl::StatusOr<JobRecord> SqliteStore::PinJob(const Tenant& tenant, std::string_view id, bool pinned) {
  return Transact([&]() -> absl::StatusOr<JobRecord> {
    ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, id));
    RETURN_IF_ERROR(database_->Run("UPDATE jobs SET pinned = ? WHERE number = ?", {pinned, number}));
    return ReadJob(number);
  });
}

absl::StatusOr<SequenceRecord> SqliteStore::PinSequence(const Tenant& tenant, std::string_view id, bool pinned) {
  return Transact([&]() -> absl::StatusOr<SequenceRecord> {
    ASSIGN_OR_RETURN(const int64_t number, SequenceNumber(tenant, id));
    RETURN_IF_ERROR(database_->Run("UPDATE sequences SET pinned = ? WHERE number = ?", {pinned, number}));
    return ReadSequence(tenant, id);
  });
}

absl::StatusOr<std::vector<Collectable>> SqliteStore::CollectableJobs() {
  return Read([&]() -> absl::StatusOr<std::vector<Collectable>> {
    std::vector<Collectable> jobs;
    RETURN_IF_ERROR(
        database_->Run(kEndedJobs, {nullptr}, [&jobs](const SqlRow& row) { jobs.push_back(ToEndedJob(row)); }));
    return jobs;
  });
}

absl::StatusOr<std::vector<Collectable>> SqliteStore::CollectableSequences() {
  return Read([&]() -> absl::StatusOr<std::vector<Collectable>> {
    std::vector<Collectable> sequences;
    RETURN_IF_ERROR(database_->Run(kUnusedSequences, {nullptr},
                                   [&](const SqlRow& row) { sequences.push_back(ToCollectable(row)); }));
    return sequences;
  });
}

absl::StatusOr<std::vector<Collectable>> SqliteStore::AbandonedSequences(absl::Time before) {
  return Read([&]() -> absl::StatusOr<std::vector<Collectable>> {
    std::vector<Collectable> sequences;
    RETURN_IF_ERROR(database_->Run(kAbandoned, {absl::ToUnixMicros(before), nullptr},
                                   [&](const SqlRow& row) { sequences.push_back(ToCollectable(row)); }));
    return sequences;
  });
}

absl::Status SqliteStore::DeleteAbandonedSequence(const Collectable& sequence) {
  return Transact([&]() -> absl::Status {
    bool same = false;
    RETURN_IF_ERROR(database_->Run(kAbandoned, {absl::ToUnixMicros(sequence.since) + 1, sequence.id},
                                   [&same](const SqlRow& /*row*/) { same = true; }));
    return same ? RemoveSequence(sequence.id) : NoLongerCollectable("sequences/" + sequence.id);
  });
}

absl::StatusOr<int64_t> SqliteStore::BytesOfJob(std::string_view id) {
  return Read([&]() -> absl::StatusOr<int64_t> {
    ASSIGN_OR_RETURN(const std::optional<int64_t> bytes,
                     database_->Number("SELECT sum(size_bytes) FROM job_files WHERE job = "
                                       "(SELECT number FROM jobs WHERE id = ?)",
                                       {id}));
    return bytes.value_or(0);
  });
}

absl::StatusOr<int64_t> SqliteStore::BytesOfSequence(std::string_view id) {
  return Read([&]() -> absl::StatusOr<int64_t> {
    ASSIGN_OR_RETURN(const std::optional<int64_t> bytes,
                     database_->Number("SELECT size_bytes FROM sequences WHERE id = ?", {id}));
    return bytes.value_or(0);
  });
}

absl::Status SqliteStore::CollectJob(const Collectable& job) {
  return Transact([&]() -> absl::Status {
    bool same = false;
    RETURN_IF_ERROR(
        database_->Run(kEndedJobs, {job.id}, [&](const SqlRow& row) { same = ToEndedJob(row).since == job.since; }));
    return same ? RemoveJob(job.id) : NoLongerCollectable("jobs/" + job.id);
  });
}

absl::Status SqliteStore::CollectSequence(const Collectable& sequence) {
  return Transact([&]() -> absl::Status {
    bool same = false;
    RETURN_IF_ERROR(database_->Run(kUnusedSequences, {sequence.id},
                                   [&](const SqlRow& row) { same = ToCollectable(row).since == sequence.since; }));
    return same ? RemoveSequence(sequence.id) : NoLongerCollectable("sequences/" + sequence.id);
  });
}

}  // namespace depthtween::server
