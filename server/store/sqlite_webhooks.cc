// What is to be told when jobs end.
#include "absl/strings/str_cat.h"
#include "server/store/error_info.h"
#include "server/store/sqlite_store_impl.h"

namespace depthtween::server {

absl::Status SqliteStore::ReadWebhook(JobRecord& job) {
  return database_->Run("SELECT url, state, attempts, next_time_us, last_error FROM webhooks WHERE job = ?",
                        {job.number}, [&job](const SqlRow& row) {
                          job.webhook = {
                              .url = row.Text(0),
                              .state = static_cast<WebhookState>(row.Int(1)),
                              .attempts = row.Int(2),
                              .next_time = row.IsNull(3) ? absl::InfiniteFuture() : absl::FromUnixMicros(row.Int64(3)),
                              .last_error = row.Text(4)};
                        });
}

absl::Status SqliteStore::TellOfEnd(int64_t job) {
  return database_->Run(
      "UPDATE webhooks SET state = ?, event_id = (SELECT id || '-' || attempt FROM jobs WHERE number = ?2), attempts = "
      "0, next_time_us = ?3, last_error = '' WHERE job = ?2",
      {WebhookState::kSending, job, absl::ToUnixMicros(absl::Now())});
}

absl::Status SqliteStore::TellOfNextEnd(int64_t job) {
  return database_->Run(
      "UPDATE webhooks SET state = ?, event_id = '', attempts = 0, next_time_us = NULL, last_error = '' WHERE job = ?",
      {WebhookState::kWaiting, job});
}

absl::StatusOr<std::vector<DueWebhook>> SqliteStore::DueWebhooks(absl::Time now, int count) {
  return Read([&]() -> absl::StatusOr<std::vector<DueWebhook>> {
    std::vector<DueWebhook> due;
    RETURN_IF_ERROR(database_->Run(
        "SELECT w.event_id, j.id, w.url, w.attempts FROM webhooks w JOIN jobs j ON j.number = w.job "
        "WHERE w.state = 2 AND w.next_time_us <= ? ORDER BY w.next_time_us LIMIT ?",
        {absl::ToUnixMicros(now), count}, [&due](const SqlRow& row) {
          due.push_back({.event_id = row.Text(0), .job_id = row.Text(1), .url = row.Text(2), .attempts = row.Int(3)});
        }));
    return due;
  });
}

absl::Status SqliteStore::RecordWebhook(std::string_view event_id, const WebhookRecord& now) {
  return Transact([&]() -> absl::Status {
    RETURN_IF_ERROR(database_->Run(
        "UPDATE webhooks SET state = ?, attempts = ?, next_time_us = ?, last_error = ? WHERE event_id = ? AND state = "
        "2",
        {now.state, now.attempts,
         now.next_time == absl::InfiniteFuture() ? SqlValue(nullptr) : SqlValue(absl::ToUnixMicros(now.next_time)),
         now.last_error, event_id}));
    if (database_->ChangedRows() == 1) return absl::OkStatus();
    return absl::NotFoundError(absl::StrCat("nothing is to be sent for the event ", View(event_id)));
  });
}

}  // namespace depthtween::server
