// Jobs as their owners see them.
#include "absl/strings/str_format.h"
#include "nlohmann/json.hpp"
#include "proto/depthtween/sha256.h"
#include "server/store/error_info.h"
#include "server/store/records_json.h"
#include "server/store/resource_names.h"
#include "server/store/sqlite_store_impl.h"

namespace depthtween::server {
namespace {

std::string JobScope(const Tenant& tenant) { return "job/" + tenant.name(); }

constexpr char kJobColumns[] =
    "SELECT id, number, display_name, sequence_id, kind, options, threads, recording, state, attempt, error_code, "
    "error_message, create_time_us, start_time_us, end_time_us, intervals_done, intervals_total, frames_done, "
    "frames_total, interval_seconds, depth_from, self_check, clock_estimate, error_info, tenant, priority, "
    "queue_limit_us, run_limit_us, pinned, warnings FROM jobs ";

absl::Time ToTime(const SqlRow& row, int column) {
  return row.IsNull(column) ? absl::InfiniteFuture() : absl::FromUnixMicros(row.Int64(column));
}

absl::StatusOr<JobRecord> ToJob(const SqlRow& row, JobDetail detail = JobDetail::kFull) {
  JobRecord job = {.id = row.Text(0),
                   .number = row.Int64(1),
                   .display_name = row.Text(2),
                   .sequence_id = row.Text(3),
                   .kind = static_cast<JobKind>(row.Int(4)),
                   .options = row.Text(5),
                   .threads = row.Int(6),
                   .priority = row.Int(25),
                   .limits = {.queue = absl::Microseconds(row.Int64(26)), .run = absl::Microseconds(row.Int64(27))},
                   .pinned = row.Int(28) != 0,
                   .depth_from = row.Text(20),
                   .tenant = row.Text(24),
                   .state = static_cast<JobState>(row.Int(8)),
                   .attempt = row.Int(9),
                   .error = absl::Status(static_cast<absl::StatusCode>(row.Int(10)), row.Text(11)),
                   .create_time = ToTime(row, 12),
                   .start_time = ToTime(row, 13),
                   .end_time = ToTime(row, 14),
                   .intervals_done = row.Int(15),
                   .intervals_total = row.Int(16),
                   .frames_done = row.Int(17),
                   .frames_total = row.Int(18),
                   .interval_seconds = row.Real(19)};
  ASSIGN_OR_RETURN(job.facts, FactsOfJob(job.kind, job.options));
  if (!row.IsNull(23)) {
    ASSIGN_OR_RETURN(const ErrorInfo info, ErrorInfoFromJson(row.Text(23)));
    job.error = WithErrorInfo(job.error, info);
  }
  if (detail == JobDetail::kBasic) return job;
  ASSIGN_OR_RETURN(job.recording, RecordingFromJson(row.Text(7)));
  if (!row.IsNull(21)) {
    absl::StatusOr<SelfCheck> check = ParseSelfCheck(row.Text(21));
    if (!check.ok()) return absl::DataLossError(absl::StrCat("database: damaged record: ", check.status().message()));
    job.self_check = *std::move(check);
  }
  if (!row.IsNull(22)) {
    ASSIGN_OR_RETURN(job.clock_estimate, ReadClockEstimate(row.Text(22)));
  }
  ASSIGN_OR_RETURN(job.warnings, ReadWarnings(row.Text(29)));
  return job;
}

std::string Fingerprint(const NewJob& job) {
  Sha256 hash;
  hash.Update(absl::StrCat(job.sequence_id, "\n", job.kind, "\n", job.options, "\n", job.threads, "\n", job.priority,
                           "\n", job.display_name, "\n", job.depth_from));
  // What came later is added only where it is set, so that requests of before keep their fingerprint.
  if (job.limits.queue != absl::ZeroDuration() || job.limits.run != absl::ZeroDuration() || job.pinned) {
    hash.Update(absl::StrCat("\n", absl::ToInt64Microseconds(job.limits.queue), " ",
                             absl::ToInt64Microseconds(job.limits.run), " ", job.pinned));
  }
  for (const RenderRecord& render : job.renders) hash.Update("\n" + render.options);
  // Only where there is one, so that the requests of older servers stay known.
  if (!job.webhook_url.empty()) hash.Update("\nwebhook " + job.webhook_url);
  return Hex(hash.Finish());
}

}  // namespace

absl::StatusOr<int64_t> SqliteStore::JobNumber(const Tenant& tenant, std::string_view id) {
  ASSIGN_OR_RETURN(
      const std::optional<int64_t> number,
      database_->Number("SELECT number FROM jobs WHERE id = ?1 AND (?2 = '' OR tenant = ?2)", {id, tenant.name()}));
  if (!number) return NoSuchResource("jobs/" + std::string(id));
  return *number;
}

absl::StatusOr<JobRecord> SqliteStore::ReadJob(int64_t number) {
  static const std::string sql = std::string(kJobColumns) + "WHERE number = ?";
  absl::StatusOr<JobRecord> job = absl::InternalError(absl::StrCat("database: no job ", number));
  RETURN_IF_ERROR(database_->Run(sql.c_str(), {number}, [&job](const SqlRow& row) { job = ToJob(row); }));
  RETURN_IF_ERROR(job.status());
  RETURN_IF_ERROR(ReadRenders(*job));
  RETURN_IF_ERROR(ReadWebhook(*job));
  if (job->state == JobState::kQueued) {
    ASSIGN_OR_RETURN(const std::optional<int64_t> ahead,
                     database_->Number("SELECT count(*) FROM jobs WHERE tenant = ?1 AND (state IN (2, 3) OR (state = 1 "
                                       "AND (priority > ?2 OR (priority = ?2 AND number < ?3))))",
                                       {job->tenant, job->priority, number}));
    job->queue_position = static_cast<int>(*ahead);
  }
  return job;
}

absl::StatusOr<std::map<std::string, int, std::less<>>> SqliteStore::ReadQueuePositions(const Tenant& tenant) {
  std::map<std::string, int, std::less<>> positions;
  RETURN_IF_ERROR(database_->Run(
      "SELECT j.id, coalesce(b.jobs, 0) + row_number() OVER (PARTITION BY j.tenant ORDER BY j.priority DESC, "
      "j.number) - 1 FROM jobs j LEFT JOIN (SELECT tenant, count(*) AS jobs FROM jobs WHERE state IN (2, 3) GROUP BY "
      "tenant) b ON b.tenant = j.tenant WHERE j.state = 1 AND (?1 = '' OR j.tenant = ?1)",
      {tenant.name()}, [&positions](const SqlRow& row) { positions.emplace(row.Text(0), row.Int(1)); }));
  return positions;
}

absl::Status SqliteStore::ReadRenders(JobRecord& job, JobDetail detail) {
  if (detail == JobDetail::kBasic) {
    return database_->Run(
        "SELECT frames_done, seconds FROM renders WHERE job = ? ORDER BY idx", {job.number},
        [&job](const SqlRow& row) { job.renders.push_back({.frames_done = row.Int(0), .seconds = row.Real(1)}); });
  }
  absl::Status damage;
  RETURN_IF_ERROR(database_->Run("SELECT plan, frames_done, seconds FROM renders WHERE job = ? ORDER BY idx",
                                 {job.number}, [&](const SqlRow& row) {
                                   absl::StatusOr<RenderRecord> render = RenderRecordFromJson(row.Text(0));
                                   damage.Update(render.status());
                                   if (!render.ok()) return;
                                   render->frames_done = row.Int(1);
                                   render->seconds = row.Real(2);
                                   job.renders.push_back(*std::move(render));
                                 }));
  return damage;
}

absl::StatusOr<JobRecord> SqliteStore::FindDepthFrom(const Tenant& tenant, const NewJob& job) {
  if (job.renders.empty()) {
    return BadField("job.depth_from", "job.depth_from reuses depth for renders, but this job has no renders: add some");
  }
  ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, job.depth_from));
  ASSIGN_OR_RETURN(JobRecord from, ReadJob(number));
  const std::string name = "jobs/" + job.depth_from;
  if (from.state != JobState::kSucceeded) {
    return WrongState(ToString(from.state), absl::StrCat(name, " is ", std::string(ToString(from.state)),
                                                         ", must be SUCCEEDED before its depth can be reused"));
  }
  if (from.kind != JobKind::kUpsample) {
    return BadField("job.depth_from", absl::StrCat("job.depth_from = ", name, " has scene flow and no depth to reuse"));
  }
  if (from.sequence_id != job.sequence_id || !GiveSameDepth(from.options, job.options)) {
    return BadField("job.depth_from",
                    absl::StrCat("job.depth_from = ", name,
                                 ", must have the sequence of this job and all of its options but self_check and "
                                 "scene_flow"));
  }
  ASSIGN_OR_RETURN(const JobFacts facts, FactsOfJob(job.kind, job.options));
  if (facts.outputs.size() > from.facts.outputs.size()) {
    return BadField("job.options.scene_flow",
                    absl::StrCat("job.options.scene_flow needs motion that ", name,
                                 ", whose depth is reused, did not keep: leave it out, or compute the depth again"));
  }
  return from;
}

absl::Status SqliteStore::EndJob(int64_t number, JobState state, const absl::Status& error) {
  const std::optional<ErrorInfo> info = GetErrorInfo(error);
  RETURN_IF_ERROR(database_->Run(
      "UPDATE jobs SET state = ?, error_code = ?, error_message = ?, error_info = ?, end_time_us = ? WHERE number = ?",
      {state, error.code(), std::string(error.message()), info ? SqlValue(ToJson(*info)) : SqlValue(nullptr),
       absl::ToUnixMicros(absl::Now()), number}));
  return TellOfEnd(number);
}

absl::StatusOr<JobRecord> SqliteStore::CreateJob(const Tenant& tenant, const NewJob& order, std::string_view request_id,
                                                 bool validate_only) {
  const Limits limits = limits_.Get();
  if (tenant.name().empty()) return absl::InternalError("CreateJob needs a tenant");
  RETURN_IF_ERROR(CheckText("job.display_name", order.display_name, limits.max_display_name_bytes));
  ASSIGN_OR_RETURN(const NewJob job, order.Checked());
  ASSIGN_OR_RETURN(const JobFacts facts, FactsOfJob(job.kind, job.options));
  const std::string fingerprint = Fingerprint(job);
  return Transact([&]() -> absl::StatusOr<JobRecord> {
    ASSIGN_OR_RETURN(const std::optional<std::string> made, MadeBefore(JobScope(tenant), request_id, fingerprint));
    if (made) {
      ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, *made));
      return ReadJob(number);
    }
    ASSIGN_OR_RETURN(const SequenceRecord sequence, ReadSequence(tenant, job.sequence_id));
    if (sequence.state != SequenceState::kReady) {
      return WrongState(ToString(sequence.state),
                        absl::StrCat("sequences/", job.sequence_id, " is ", std::string(ToString(sequence.state)),
                                     ", must be READY before a job can use it"));
    }
    std::optional<SelfCheck> self_check;
    if (!job.depth_from.empty()) {
      ASSIGN_OR_RETURN(JobRecord from, FindDepthFrom(tenant, job));
      if (facts.self_check) self_check = std::move(from.self_check);
    }
    ASSIGN_OR_RETURN(const std::optional<int64_t> queued,
                     database_->Number("SELECT count(*) FROM jobs WHERE state = 1"));
    if (*queued >= limits.max_queued_jobs) {
      return LimitExceeded("max_queued_jobs", limits.max_queued_jobs,
                           absl::StrFormat("the queue is full with %d jobs; try again when some have run", *queued));
    }
    ASSIGN_OR_RETURN(const std::optional<int64_t> own_queued,
                     database_->Number("SELECT count(*) FROM jobs WHERE state = 1 AND tenant = ?", {tenant.name()}));
    if (limits.max_tenant_queued_jobs > 0 && *own_queued >= limits.max_tenant_queued_jobs) {
      return LimitExceeded(
          "max_tenant_queued_jobs", limits.max_tenant_queued_jobs,
          absl::StrFormat("%d jobs of the tenant %s are queued, which is its limit; try again when some have run",
                          *own_queued, tenant.name()));
    }
    const absl::Time now = absl::FromUnixMicros(absl::ToUnixMicros(absl::Now()));
    if (validate_only) {
      return JobRecord{
          .display_name = job.display_name,
          .sequence_id = job.sequence_id,
          .kind = job.kind,
          .options = job.options,
          .facts = facts,
          .threads = job.threads,
          .priority = job.priority,
          .limits = job.limits,
          .pinned = job.pinned,
          .renders = job.renders,
          .depth_from = job.depth_from,
          .tenant = tenant.name(),
          .recording = *sequence.validation.recording,
          .create_time = now,
          .start_time = absl::InfiniteFuture(),
          .end_time = absl::InfiniteFuture(),
          .queue_position = static_cast<int>(*own_queued),
          .webhook = job.webhook_url.empty() ? std::nullopt : std::optional(WebhookRecord{.url = job.webhook_url})};
    }
    const std::string id = NewId();
    RETURN_IF_ERROR(database_->Run(
        "INSERT INTO jobs (id, display_name, sequence_id, recording, kind, options, threads, state, create_time_us, "
        "queue_time_us, depth_from, self_check, tenant, priority, queue_limit_us, run_limit_us, pinned) "
        "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?9, ?9, ?, ?, ?, ?, ?, ?, ?)",
        {id, job.display_name, job.sequence_id, ToJson(*sequence.validation.recording), job.kind, job.options,
         job.threads, JobState::kQueued, absl::ToUnixMicros(now), job.depth_from,
         self_check ? SqlValue(ToJson(*self_check).dump()) : nullptr, tenant.name(), job.priority,
         absl::ToInt64Microseconds(job.limits.queue), absl::ToInt64Microseconds(job.limits.run), job.pinned}));
    const int64_t number = database_->LastInsertedRow();
    for (size_t i = 0; i < job.renders.size(); ++i) {
      RETURN_IF_ERROR(
          database_->Run("INSERT INTO renders (job, idx, plan) VALUES (?, ?, ?)", {number, i, ToJson(job.renders[i])}));
    }
    if (!job.webhook_url.empty()) {
      RETURN_IF_ERROR(database_->Run("INSERT INTO webhooks (job, url) VALUES (?, ?)", {number, job.webhook_url}));
    }
    RETURN_IF_ERROR(RememberRequest(JobScope(tenant), request_id, fingerprint, id));
    ASSIGN_OR_RETURN(JobRecord made_now, ReadJob(number));
    RETURN_IF_ERROR(AddFirstTask(made_now));
    return made_now;
  });
}

absl::StatusOr<JobRecord> SqliteStore::GetJob(const Tenant& tenant, std::string_view id) {
  return Read([&]() -> absl::StatusOr<JobRecord> {
    ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, id));
    return ReadJob(number);
  });
}

absl::StatusOr<Page<JobRecord>> SqliteStore::ListJobs(const Tenant& tenant, const JobFilter& filter,
                                                      const PageRequest& page, JobDetail detail) {
  const int state = filter.state ? static_cast<int>(*filter.state) : 0;
  const std::string sequence = filter.sequence_id.value_or("");
  const std::string list = absl::StrCat("jobs of ", tenant.name(), " state=", state, " sequence=", sequence);
  ASSIGN_OR_RETURN(const int64_t before, ParsePageToken(page, list));
  ASSIGN_OR_RETURN(const int size, CheckPageSize(page, limits_.Get()));
  static const std::string sql = std::string(kJobColumns) +
                                 "WHERE number < ?1 AND (?2 = 0 OR state = ?2) AND (?3 = '' OR sequence_id = ?3) "
                                 "AND (?5 = '' OR tenant = ?5) "
                                 "ORDER BY number DESC LIMIT ?4";
  return Read([&]() -> absl::StatusOr<Page<JobRecord>> {
    Page<JobRecord> result;
    absl::Status damage;
    bool more = false;
    // One row beyond the page tells whether there is a next one.
    RETURN_IF_ERROR(
        database_->Run(sql.c_str(), {before, state, sequence, size + 1, tenant.name()}, [&](const SqlRow& row) {
          more = static_cast<int>(result.items.size()) == size;
          if (more) return;
          absl::StatusOr<JobRecord> job = ToJob(row, detail);
          damage.Update(job.status());
          if (job.ok()) result.items.push_back(*std::move(job));
        }));
    RETURN_IF_ERROR(damage);
    bool queued = false;
    for (JobRecord& job : result.items) {
      RETURN_IF_ERROR(ReadRenders(job, detail));
      if (detail == JobDetail::kFull) RETURN_IF_ERROR(ReadWebhook(job));
      queued = queued || job.state == JobState::kQueued;
    }
    if (queued) {
      ASSIGN_OR_RETURN(const auto positions, ReadQueuePositions(tenant));
      for (JobRecord& job : result.items) {
        if (const auto found = positions.find(job.id); found != positions.end()) job.queue_position = found->second;
      }
    }
    if (more) result.next_token = MakePageToken(result.items.back().number, list);
    return result;
  });
}

absl::StatusOr<std::vector<Store::JobCount>> SqliteStore::CountJobs() {
  return Read([&]() -> absl::StatusOr<std::vector<JobCount>> {
    std::vector<JobCount> counts;
    RETURN_IF_ERROR(database_->Run(
        "SELECT tenant, state, count(*) FROM jobs GROUP BY tenant, state", {}, [&counts](const SqlRow& row) {
          counts.push_back({.tenant = row.Text(0), .state = static_cast<JobState>(row.Int(1)), .count = row.Int(2)});
        }));
    return counts;
  });
}

absl::StatusOr<std::map<std::string, int, std::less<>>> SqliteStore::QueuePositions() {
  return Read([&] { return ReadQueuePositions(Tenant::Everyone()); });
}

absl::Status SqliteStore::DeleteJob(const Tenant& tenant, std::string_view id) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, id));
    ASSIGN_OR_RETURN(const JobRecord job, ReadJob(number));
    if (!HasEnded(job.state)) {
      return WrongState(ToString(job.state),
                        absl::StrCat("jobs/", std::string(id), " is ", std::string(ToString(job.state)),
                                     "; cancel it before deleting it"));
    }
    return RemoveJob(id);
  });
}

absl::Status SqliteStore::RemoveJob(std::string_view id) {
  RETURN_IF_ERROR(database_->Run("DELETE FROM requests WHERE made_id = ?", {id}));
  return database_->Run("DELETE FROM jobs WHERE id = ?", {id});
}

absl::StatusOr<JobRecord> SqliteStore::CancelJob(const Tenant& tenant, std::string_view id) {
  return Transact([&]() -> absl::StatusOr<JobRecord> {
    ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, id));
    ASSIGN_OR_RETURN(const JobRecord job, ReadJob(number));
    if (job.state == JobState::kCancelling || job.state == JobState::kCancelled) return job;
    if (HasEnded(job.state)) {
      return WrongState(ToString(job.state), absl::StrCat("jobs/", std::string(id), " has already ended as ",
                                                          std::string(ToString(job.state))));
    }
    RETURN_IF_ERROR(database_->Run("DELETE FROM tasks WHERE job = ? AND running = 0", {number}));
    RETURN_IF_ERROR(database_->Run("UPDATE jobs SET state = ? WHERE number = ?", {JobState::kCancelling, number}));
    RETURN_IF_ERROR(SettleJob(number));
    return ReadJob(number);
  });
}

absl::StatusOr<JobRecord> SqliteStore::RetryJob(const Tenant& tenant, std::string_view id) {
  return Transact([&]() -> absl::StatusOr<JobRecord> {
    ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, id));
    ASSIGN_OR_RETURN(const JobRecord job, ReadJob(number));
    if (job.state != JobState::kFailed && job.state != JobState::kCancelled) {
      return WrongState(ToString(job.state),
                        absl::StrCat("jobs/", std::string(id), " is ", std::string(ToString(job.state)),
                                     ", only a FAILED or CANCELLED job can be retried"));
    }
    ASSIGN_OR_RETURN(const std::optional<int64_t> sequence,
                     database_->Number("SELECT number FROM sequences WHERE id = ?", {job.sequence_id}));
    if (!sequence) {
      return WrongState(ToString(job.state), absl::StrCat("sequences/", job.sequence_id,
                                                          " has been deleted; upload it again and create a new job"));
    }
    RETURN_IF_ERROR(database_->Run(
        "UPDATE jobs SET state = ?, attempt = attempt + 1, error_code = 0, error_message = '', error_info = NULL, "
        "start_time_us = NULL, end_time_us = NULL, queue_time_us = ? WHERE number = ?",
        {JobState::kQueued, absl::ToUnixMicros(absl::Now()), number}));
    RETURN_IF_ERROR(TellOfNextEnd(number));
    RETURN_IF_ERROR(database_->Run("UPDATE intervals SET failures = 0 WHERE job = ? AND failures > 0", {number}));
    RETURN_IF_ERROR(database_->Run("UPDATE render_parts SET failures = 0 WHERE job = ? AND failures > 0", {number}));
    if (job.intervals_total == 0) {
      RETURN_IF_ERROR(AddFirstTask(job));
    } else if (job.IsComputed()) {
      RETURN_IF_ERROR(AddTask(TaskKind::kAssemble, number, /*failures=*/0));
    }
    return ReadJob(number);
  });
}

absl::StatusOr<std::vector<PlannedInterval>> SqliteStore::JobIntervals(std::string_view id, int first, int count) {
  return Read([&]() -> absl::StatusOr<std::vector<PlannedInterval>> {
    ASSIGN_OR_RETURN(const int64_t number, JobNumber(Tenant::Everyone(), id));
    std::vector<PlannedInterval> intervals;
    RETURN_IF_ERROR(database_->Run(
        "SELECT idx, first_frame, frame_count, held FROM intervals WHERE job = ? AND idx >= ? ORDER BY idx LIMIT ?",
        {number, first, count}, [&intervals](const SqlRow& row) {
          intervals.push_back(
              {.index = row.Int(0), .first_frame = row.Int(1), .frame_count = row.Int(2), .held = row.Int(3) != 0});
        }));
    return intervals;
  });
}

absl::StatusOr<std::vector<FrameRecord>> SqliteStore::JobFrames(const Tenant& tenant, std::string_view id, int first,
                                                                int count, int render) {
  return Read([&]() -> absl::StatusOr<std::vector<FrameRecord>> {
    ASSIGN_OR_RETURN(const int64_t number, JobNumber(tenant, id));
    std::vector<FrameRecord> frames;
    const auto on_row = [&frames](const SqlRow& row) {
      frames.push_back({.index = row.Int(0),
                        .time_ns = row.Int64(1),
                        .stem = row.Text(2),
                        .ready = row.Int(3) != 0,
                        .assembled = row.IsNull(4) ? std::nullopt : std::optional(row.Int(4) != 0)});
    };
    RETURN_IF_ERROR(
        render < 0 ? database_->Run("SELECT f.idx, f.time_ns, f.stem, i.done, f.assembled FROM frames f "
                                    "JOIN intervals i ON i.job = f.job AND i.idx = f.interval "
                                    "WHERE f.job = ? AND f.idx >= ? ORDER BY f.idx LIMIT ?",
                                    {number, first, count}, on_row)
                   : database_->Run("SELECT f.idx, f.time_ns, f.stem, p.done, f.assembled FROM frames f "
                                    "JOIN render_parts p ON p.job = f.job AND p.interval = f.interval AND p.render = ? "
                                    "WHERE f.job = ? AND f.idx >= ? ORDER BY f.idx LIMIT ?",
                                    {render, number, first, count}, on_row));
    return frames;
  });
}

}  // namespace depthtween::server
