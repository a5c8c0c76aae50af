// Work: how it is claimed, recorded, and given back.
#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/store/error_info.h"
#include "server/store/records_json.h"
#include "server/store/sqlite_store_impl.h"

namespace depthtween::server {
namespace {

// The first and the last interval that must be done before `interval` can be rendered. A plan's intervals follow one
// another without gap.
std::pair<int, int> IntervalsNeeded(const JobPlan& plan, const PlannedInterval& interval, const RenderRecord& render) {
  int first = interval.first_frame - render.reach_frames;
  int last = interval.first_frame + interval.frame_count - 1 + render.reach_frames;
  if (render.anchor_frame >= 0) {
    first = std::min(first, render.anchor_frame);
    last = std::max(last, render.anchor_frame);
  }
  const auto interval_of = [&plan](int frame) {
    const auto after =
        std::upper_bound(plan.intervals.begin(), plan.intervals.end(), frame,
                         [](int wanted, const PlannedInterval& candidate) { return wanted < candidate.first_frame; });
    return after == plan.intervals.begin() ? 0 : std::prev(after)->index;
  };
  return {interval_of(first), interval_of(last)};
}

// Whether work of this kind is cut into intervals, which remember their own failures.
bool IsCut(TaskKind kind) { return kind == TaskKind::kIntervals || kind == TaskKind::kRender; }

}  // namespace

absl::Status SqliteStore::AddTask(TaskKind kind, int64_t owner, int failures) {
  const bool validate = kind == TaskKind::kValidate;
  return database_->Run("INSERT INTO tasks (kind, sequence, job, failures) VALUES (?, ?, ?, ?)",
                        {kind, validate ? SqlValue(owner) : nullptr, validate ? nullptr : SqlValue(owner), failures});
}

absl::Status SqliteStore::AddFirstTask(const JobRecord& job) {
  const bool check = job.facts.self_check && !job.self_check.has_value();
  return AddTask(check ? TaskKind::kSelfCheck : TaskKind::kPrepare, job.number, /*failures=*/0);
}

absl::StatusOr<SqliteStore::TaskRow> SqliteStore::RunningTask(int64_t number) {
  std::optional<TaskRow> task;
  RETURN_IF_ERROR(
      database_->Run("SELECT number, kind, sequence, job, failures, first_interval, interval_count, render FROM tasks "
                     "WHERE number = ? AND running = 1",
                     {number}, [&task](const SqlRow& row) {
                       task = TaskRow{.number = row.Int64(0),
                                      .kind = static_cast<TaskKind>(row.Int(1)),
                                      .sequence = row.Int64(2),
                                      .job = row.Int64(3),
                                      .failures = row.Int(4),
                                      .first_interval = row.Int(5),
                                      .interval_count = row.Int(6),
                                      .render = row.Int(7)};
                     }));
  if (!task) return absl::FailedPreconditionError(absl::StrFormat("task %d is no longer running", number));
  return *task;
}

absl::Status SqliteStore::RemoveTask(int64_t number) {
  RETURN_IF_ERROR(database_->Run("UPDATE intervals SET task = NULL WHERE task = ?", {number}));
  RETURN_IF_ERROR(database_->Run("UPDATE render_parts SET task = NULL WHERE task = ?", {number}));
  return database_->Run("DELETE FROM tasks WHERE number = ?", {number});
}

absl::StatusOr<std::optional<Task>> SqliteStore::ClaimTask(const BatchSize& batch_size, ClaimValidations validations) {
  return Transact([&]() -> absl::StatusOr<std::optional<Task>> {
    // A validation, of the tenant that has fewest running.
    int64_t validation = 0;
    if (validations != ClaimValidations::kNone) {
      RETURN_IF_ERROR(database_->Run(
          "SELECT t.number FROM tasks t JOIN sequences s ON s.number = t.sequence WHERE t.running = 0 ORDER BY "
          "(SELECT count(*) FROM tasks o JOIN sequences p ON p.number = o.sequence WHERE o.running = 1 AND p.tenant = "
          "s.tenant), t.number LIMIT 1",
          {}, [&validation](const SqlRow& row) { validation = row.Int64(0); }));
    }
    // Then the job whose turn it is, of those that have something to do: a job that runs, or one that was retried and
    // has its plan.
    ASSIGN_OR_RETURN(const int64_t job, JobWhoseTurnItIs());
    int64_t number = 0;
    if (validation != 0 && (validations == ClaimValidations::kFirst || job == 0)) {
      number = validation;
    } else if (job != 0) {
      ASSIGN_OR_RETURN(number, TakeWork(job, batch_size));
    }
    if (number == 0) return std::nullopt;
    RETURN_IF_ERROR(database_->Run("UPDATE tasks SET running = 1 WHERE number = ?", {number}));
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(number));
    Task task = {.number = number,
                 .kind = row.kind,
                 .first_interval = row.first_interval,
                 .interval_count = row.interval_count,
                 .render = row.render,
                 .failures = row.failures};
    if (row.kind == TaskKind::kValidate) {
      RETURN_IF_ERROR(database_->Run("SELECT id FROM sequences WHERE number = ?", {row.sequence},
                                     [&task](const SqlRow& found) { task.sequence_id = found.Text(0); }));
      return task;
    }
    RETURN_IF_ERROR(
        database_->Run("INSERT INTO tenants (name, last_task) SELECT tenant, ? FROM jobs WHERE number = ? "
                       "ON CONFLICT (name) DO UPDATE SET last_task = excluded.last_task",
                       {number, job}));
    RETURN_IF_ERROR(database_->Run("UPDATE jobs SET state = ?, start_time_us = ? WHERE number = ? AND state = ?",
                                   {JobState::kRunning, absl::ToUnixMicros(absl::Now()), job, JobState::kQueued}));
    RETURN_IF_ERROR(
        database_->Run("SELECT id, sequence_id FROM jobs WHERE number = ?", {job}, [&task](const SqlRow& found) {
          task.job_id = found.Text(0);
          task.sequence_id = found.Text(1);
        }));
    return task;
  });
}

absl::StatusOr<int64_t> SqliteStore::JobWhoseTurnItIs() {
  // By tenants first; a tenant that never had a turn has waited longest.
  ASSIGN_OR_RETURN(
      const std::optional<int64_t> job,
      database_->Number(
          "SELECT j.number FROM jobs j LEFT JOIN tenants n ON n.name = j.tenant "
          "LEFT JOIN (SELECT o.tenant AS tenant, count(*) AS running FROM tasks t JOIN jobs o ON o.number = t.job "
          "           WHERE t.running = 1 GROUP BY o.tenant) b ON b.tenant = j.tenant "
          "WHERE j.state IN (1, 2) AND (?1 = 0 OR coalesce(b.running, 0) < ?1) "
          "AND (EXISTS (SELECT 1 FROM tasks t WHERE t.job = j.number AND t.running = 0) "
          "  OR EXISTS (SELECT 1 FROM intervals i WHERE i.job = j.number AND i.done = 0 AND i.task IS NULL) "
          "  OR EXISTS (SELECT 1 FROM ready_parts p WHERE p.job = j.number)) "
          "ORDER BY coalesce(b.running, 0), coalesce(n.last_task, 0), j.priority DESC, j.number LIMIT 1",
          {limits_.Get().max_tenant_tasks}));
  return job.value_or(0);
}

absl::StatusOr<int64_t> SqliteStore::TakeWork(int64_t job, const BatchSize& batch_size) {
  ASSIGN_OR_RETURN(const std::optional<int64_t> task,
                   database_->Number("SELECT min(number) FROM tasks WHERE job = ? AND running = 0", {job}));
  if (task) return *task;
  ASSIGN_OR_RETURN(const JobRecord record, ReadJob(job));
  ASSIGN_OR_RETURN(const std::optional<int64_t> picture,
                   database_->Number("SELECT 1 FROM ready_parts WHERE job = ? LIMIT 1", {job}));
  if (picture) return TakeRenderParts(job, std::max(1, batch_size(record, TaskKind::kRender)));
  return TakeIntervals(job, std::max(1, batch_size(record, TaskKind::kIntervals)));
}

absl::StatusOr<int64_t> SqliteStore::TakeIntervals(int64_t job, int wanted) {
  int first = 0, count = 0, failures = 0;
  RETURN_IF_ERROR(database_->Run(
      "SELECT idx, failures FROM intervals WHERE job = ? AND done = 0 AND task IS NULL ORDER BY idx LIMIT ?",
      {job, wanted}, [&](const SqlRow& row) {
        if (count == 0) {
          first = row.Int(0);
          failures = row.Int(1);
        }
        if (row.Int(0) == first + count) ++count;
      }));
  RETURN_IF_ERROR(
      database_->Run("INSERT INTO tasks (kind, job, failures, first_interval, interval_count) VALUES (?, ?, ?, ?, ?)",
                     {TaskKind::kIntervals, job, failures, first, count}));
  const int64_t number = database_->LastInsertedRow();
  RETURN_IF_ERROR(database_->Run("UPDATE intervals SET task = ? WHERE job = ? AND idx >= ? AND idx < ?",
                                 {number, job, first, first + count}));
  return number;
}

absl::StatusOr<int64_t> SqliteStore::TakeRenderParts(int64_t job, int wanted) {
  int render = 0, first = 0, count = 0, failures = 0;
  RETURN_IF_ERROR(
      database_->Run("SELECT render, interval FROM ready_parts WHERE job = ? ORDER BY interval, render LIMIT 1", {job},
                     [&](const SqlRow& row) { render = row.Int(0), first = row.Int(1); }));
  RETURN_IF_ERROR(database_->Run(
      "SELECT interval, failures FROM ready_parts WHERE job = ? AND render = ? AND interval >= ? ORDER BY interval "
      "LIMIT ?",
      {job, render, first, wanted}, [&](const SqlRow& row) {
        if (count == 0) failures = row.Int(1);
        if (row.Int(0) == first + count) ++count;
      }));
  RETURN_IF_ERROR(database_->Run(
      "INSERT INTO tasks (kind, job, failures, first_interval, interval_count, render) VALUES (?, ?, ?, ?, ?, ?)",
      {TaskKind::kRender, job, failures, first, count, render}));
  const int64_t number = database_->LastInsertedRow();
  RETURN_IF_ERROR(
      database_->Run("UPDATE render_parts SET task = ? WHERE job = ? AND render = ? AND interval >= ? AND interval < ?",
                     {number, job, render, first, first + count}));
  return number;
}

absl::Status SqliteStore::FinishSelfCheck(int64_t task, const SelfCheck& check) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    RETURN_IF_ERROR(database_->Run("UPDATE jobs SET self_check = ? WHERE number = ?", {ToJson(check).dump(), row.job}));
    RETURN_IF_ERROR(RemoveTask(task));
    ASSIGN_OR_RETURN(const JobRecord job, ReadJob(row.job));
    if (job.state == JobState::kRunning) RETURN_IF_ERROR(AddFirstTask(job));
    return SettleJob(row.job);
  });
}

absl::Status SqliteStore::FinishPrepare(int64_t task, const JobPlan& plan) {
  if (plan.intervals.empty() || plan.frames.empty()) {
    return absl::InvalidArgumentError("the plan has no intervals or no frames, must have both");
  }
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    for (const PlannedInterval& interval : plan.intervals) {
      RETURN_IF_ERROR(database_->Run(
          "INSERT INTO intervals (job, idx, first_frame, frame_count, held, done) VALUES (?, ?, ?, ?, ?, ?)",
          {row.job, interval.index, interval.first_frame, interval.frame_count, interval.held, plan.depth_done}));
      for (int i = interval.first_frame; i < interval.first_frame + interval.frame_count; ++i) {
        const PlannedFrame& frame = plan.frames.at(static_cast<size_t>(i));
        RETURN_IF_ERROR(database_->Run("INSERT INTO frames (job, idx, time_ns, stem, interval) VALUES (?, ?, ?, ?, ?)",
                                       {row.job, frame.index, frame.time_ns, frame.stem, interval.index}));
      }
    }
    RETURN_IF_ERROR(
        database_->Run("UPDATE jobs SET intervals_total = ?, frames_total = ?, clock_estimate = ?, warnings = ? "
                       "WHERE number = ?",
                       {plan.intervals.size(), plan.frames.size(),
                        plan.clock_estimate ? SqlValue(ToJson(*plan.clock_estimate).dump()) : nullptr,
                        nlohmann::json(plan.warnings).dump(), row.job}));
    if (plan.depth_done) {
      RETURN_IF_ERROR(database_->Run(
          "UPDATE jobs SET intervals_done = intervals_total, frames_done = frames_total WHERE number = ?", {row.job}));
    }
    ASSIGN_OR_RETURN(const JobRecord job, ReadJob(row.job));
    for (size_t render = 0; render < job.renders.size(); ++render) {
      for (const PlannedInterval& interval : plan.intervals) {
        const auto [needs_first, needs_last] = IntervalsNeeded(plan, interval, job.renders[render]);
        RETURN_IF_ERROR(database_->Run(
            "INSERT INTO render_parts (job, interval, render, needs_first, needs_last) VALUES (?, ?, ?, ?, ?)",
            {row.job, interval.index, render, needs_first, needs_last}));
      }
    }
    RETURN_IF_ERROR(KeepJobFiles(row.job, plan.files));
    RETURN_IF_ERROR(RemoveTask(task));
    return SettleJob(row.job);
  });
}

absl::StatusOr<JobRecord> SqliteStore::FinishInterval(int64_t task, int interval, double seconds,
                                                      const std::vector<FileChecksum>& files) {
  return Transact([&]() -> absl::StatusOr<JobRecord> {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    if (interval < row.first_interval || interval >= row.first_interval + row.interval_count) {
      return absl::InternalError(absl::StrFormat("task %d reported interval %d, it was given %d to %d", task, interval,
                                                 row.first_interval, row.first_interval + row.interval_count - 1));
    }
    RETURN_IF_ERROR(KeepJobFiles(row.job, files));
    if (row.kind == TaskKind::kRender) {
      RETURN_IF_ERROR(database_->Run(
          "UPDATE render_parts SET done = 1, task = NULL WHERE job = ? AND interval = ? AND render = ? AND done = 0",
          {row.job, interval, row.render}));
      if (database_->ChangedRows() > 0) {
        RETURN_IF_ERROR(database_->Run(
            "UPDATE renders SET seconds = seconds + ?1, frames_done = frames_done + "
            "(SELECT frame_count FROM intervals WHERE job = ?2 AND idx = ?3) WHERE job = ?2 AND idx = ?4",
            {seconds, row.job, interval, row.render}));
      }
      return ReadJob(row.job);
    }
    RETURN_IF_ERROR(
        database_->Run("UPDATE intervals SET done = 1, task = NULL, seconds = ? WHERE job = ? AND idx = ? AND done = 0",
                       {seconds, row.job, interval}));
    if (database_->ChangedRows() > 0) {
      RETURN_IF_ERROR(database_->Run(
          "UPDATE jobs SET intervals_done = intervals_done + 1, interval_seconds = interval_seconds + ?1, "
          "frames_done = frames_done + (SELECT frame_count FROM intervals WHERE job = ?2 AND idx = ?3) WHERE number = "
          "?2",
          {seconds, row.job, interval}));
    }
    return ReadJob(row.job);
  });
}

absl::Status SqliteStore::CompleteTask(int64_t task, const std::optional<std::vector<int>>& assembled,
                                       const std::vector<FileChecksum>& files) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    RETURN_IF_ERROR(RemoveTask(task));
    RETURN_IF_ERROR(KeepJobFiles(row.job, files));
    if (row.kind == TaskKind::kAssemble) {
      ASSIGN_OR_RETURN(const JobRecord job, ReadJob(row.job));
      if (assembled) {
        RETURN_IF_ERROR(database_->Run("UPDATE frames SET assembled = 0 WHERE job = ?", {row.job}));
        for (const int frame : *assembled) {
          RETURN_IF_ERROR(
              database_->Run("UPDATE frames SET assembled = 1 WHERE job = ? AND idx = ?", {row.job, frame}));
        }
      }
      if (job.state == JobState::kRunning) return EndJob(row.job, JobState::kSucceeded, absl::OkStatus());
    }
    return SettleJob(row.job);
  });
}

absl::Status SqliteStore::SettleJob(int64_t job) {
  ASSIGN_OR_RETURN(const std::optional<int64_t> tasks,
                   database_->Number("SELECT count(*) FROM tasks WHERE job = ?", {job}));
  if (*tasks > 0) return absl::OkStatus();
  ASSIGN_OR_RETURN(const JobRecord record, ReadJob(job));
  if (record.state == JobState::kCancelling) return EndJob(job, JobState::kCancelled, absl::OkStatus());
  if (record.state == JobState::kRunning && record.IsComputed()) {
    return AddTask(TaskKind::kAssemble, job, /*failures=*/0);
  }
  return absl::OkStatus();
}

absl::Status SqliteStore::Release(const TaskRow& task) {
  RETURN_IF_ERROR(RemoveTask(task.number));
  if (task.kind == TaskKind::kValidate) return AddTask(task.kind, task.sequence, task.failures);
  ASSIGN_OR_RETURN(const JobRecord job, ReadJob(task.job));
  // Intervals become batches when they are claimed, so they need no waiting task.
  if (job.state == JobState::kRunning && !IsCut(task.kind)) {
    RETURN_IF_ERROR(AddTask(task.kind, task.job, task.failures));
  }
  return SettleJob(task.job);
}

absl::Status SqliteStore::Fail(const TaskRow& task, const absl::Status& error, bool retry) {
  if (task.kind != TaskKind::kValidate) {
    ASSIGN_OR_RETURN(const JobRecord job, ReadJob(task.job));
    if (job.state == JobState::kCancelling) return Release(task);
  }
  int failures = task.failures + 1;
  if (IsCut(task.kind)) {
    // The first interval left undone is the one to blame; the others were never begun.
    failures = 1;
    const bool render = task.kind == TaskKind::kRender;
    ASSIGN_OR_RETURN(
        const std::optional<int64_t> blamed,
        database_->Number(render ? "UPDATE render_parts SET failures = failures + 1 WHERE task = ?1 AND interval = "
                                   "(SELECT min(interval) FROM render_parts WHERE task = ?1) RETURNING failures"
                                 : "UPDATE intervals SET failures = failures + 1 WHERE task = ?1 AND idx = "
                                   "(SELECT min(idx) FROM intervals WHERE task = ?1) RETURNING failures",
                          {task.number}));
    if (blamed) failures = static_cast<int>(*blamed);
  }
  RETURN_IF_ERROR(RemoveTask(task.number));
  if (retry && failures < kMaxAttempts) {
    if (IsCut(task.kind)) return SettleJob(task.job);
    return AddTask(task.kind, task.kind == TaskKind::kValidate ? task.sequence : task.job, failures);
  }
  if (task.kind == TaskKind::kValidate) {
    RETURN_IF_ERROR(database_->Run("UPDATE sequences SET validation = ? WHERE number = ?",
                                   {ToJson(ValidationResult{.error = error}), task.sequence}));
    return TouchSequence(task.sequence, SequenceState::kInvalid);
  }
  return FailJob(task.job, error);
}

absl::Status SqliteStore::FailJob(int64_t job, const absl::Status& error) {
  RETURN_IF_ERROR(
      database_->Run("UPDATE intervals SET task = NULL WHERE task IN (SELECT number FROM tasks WHERE job = ?)", {job}));
  RETURN_IF_ERROR(database_->Run(
      "UPDATE render_parts SET task = NULL WHERE task IN (SELECT number FROM tasks WHERE job = ?)", {job}));
  RETURN_IF_ERROR(database_->Run("DELETE FROM tasks WHERE job = ?", {job}));
  return EndJob(job, JobState::kFailed, error);
}

absl::Status SqliteStore::FailTask(int64_t task, const absl::Status& error, bool retry) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    return Fail(row, error, retry);
  });
}

absl::Status SqliteStore::ReleaseTask(int64_t task) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    return Release(row);
  });
}

absl::Status SqliteStore::ReleaseAllTasks() {
  return Transact([&]() -> absl::Status {
    std::vector<int64_t> running;
    RETURN_IF_ERROR(database_->Run("SELECT number FROM tasks WHERE running = 1", {},
                                   [&running](const SqlRow& row) { running.push_back(row.Int64(0)); }));
    for (const int64_t number : running) {
      ASSIGN_OR_RETURN(const TaskRow row, RunningTask(number));
      RETURN_IF_ERROR(Release(row));
    }
    return absl::OkStatus();
  });
}

}  // namespace depthtween::server
