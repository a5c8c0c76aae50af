#include "server/store/sqlite_store.h"

#include <cstdint>
#include <limits>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "proto/depthtween/crc32c.h"
#include "server/store/error_info.h"
#include "server/store/schema.h"
#include "server/store/sqlite_store_impl.h"

namespace depthtween::server {

absl::StatusOr<std::unique_ptr<Store>> OpenSqliteStore(const std::string& file, const Limits& limits,
                                                       int checkpoint_pages) {
  ASSIGN_OR_RETURN(std::unique_ptr<Database> database, Database::Open(file, checkpoint_pages));
  ASSIGN_OR_RETURN(const int64_t version, database->SchemaVersion());
  if (version > 0 && version < static_cast<int64_t>(SchemaSteps().size())) {
    RETURN_IF_ERROR(database->CopyTo(absl::StrCat(file, ".schema-", version)));
  }
  RETURN_IF_ERROR(WithContext(database->Migrate(SchemaSteps()), file));
  return std::make_unique<SqliteStore>(std::move(database), limits);
}

absl::StatusOr<std::unique_ptr<Store>> OpenSqliteStoreToRead(const std::string& file) {
  ASSIGN_OR_RETURN(std::unique_ptr<Database> database, Database::OpenToRead(file));
  ASSIGN_OR_RETURN(const int64_t version, database->SchemaVersion());
  if (version != static_cast<int64_t>(SchemaSteps().size())) {
    return absl::FailedPreconditionError(
        absl::StrFormat("%s has schema %d, this program knows %d; a start of the server brings an older one up to date",
                        file, version, SchemaSteps().size()));
  }
  return std::make_unique<SqliteStore>(std::move(database), Limits());
}

absl::StatusOr<std::optional<std::string>> SqliteStore::FolderId() {
  return Read([&]() -> absl::StatusOr<std::optional<std::string>> {
    std::optional<std::string> id;
    RETURN_IF_ERROR(database_->Run("SELECT id FROM data_folder", {}, [&id](const SqlRow& row) { id = row.Text(0); }));
    return id;
  });
}

absl::Status SqliteStore::SetFolderId(std::string_view id) {
  return Transact([&]() -> absl::Status {
    RETURN_IF_ERROR(database_->Run("DELETE FROM data_folder"));
    return database_->Run("INSERT INTO data_folder (id) VALUES (?)", {id});
  });
}

absl::Status SqliteStore::Probe() {
  // SQLite writes nothing for an UPDATE that changes nothing.
  ASSIGN_OR_RETURN(const std::optional<std::string> id, FolderId());
  if (id) RETURN_IF_ERROR(SetFolderId(*id));
  const std::lock_guard lock(mutex_);
  return database_->damage();
}

absl::Status CheckSqliteFile(const std::string& file) {
  ASSIGN_OR_RETURN(const std::unique_ptr<Database> database, Database::OpenToRead(file));
  std::string verdict;
  RETURN_IF_ERROR(database->Run("PRAGMA integrity_check(10)", {}, [&verdict](const SqlRow& row) {
    absl::StrAppend(&verdict, verdict.empty() ? "" : "; ", row.Text(0));
  }));
  return verdict == "ok" ? absl::OkStatus() : absl::DataLossError(absl::StrCat(file, " is damaged: ", verdict));
}

absl::StatusOr<std::optional<std::string>> SqliteStore::MadeBefore(const std::string& scope,
                                                                   std::string_view request_id,
                                                                   const std::string& fingerprint) {
  RETURN_IF_ERROR(CheckText("request_id", request_id, limits_.Get().max_request_id_bytes));
  std::optional<std::string> made;
  if (request_id.empty()) return made;
  bool same = true;
  RETURN_IF_ERROR(database_->Run("SELECT fingerprint, made_id FROM requests WHERE scope = ? AND request_id = ?",
                                 {scope, request_id}, [&](const SqlRow& row) {
                                   same = row.Text(0) == fingerprint;
                                   made = row.Text(1);
                                 }));
  if (!same) {
    return WithErrorInfo(absl::AlreadyExistsError("this request_id was used for a different request; choose another"),
                         {.reason = "IDEMPOTENCY_MISMATCH", .metadata = {{"request_id", std::string(request_id)}}});
  }
  return made;
}

absl::Status SqliteStore::RememberRequest(const std::string& scope, std::string_view request_id,
                                          const std::string& fingerprint, const std::string& made_id) {
  if (request_id.empty()) return absl::OkStatus();
  return database_->Run("INSERT INTO requests (scope, request_id, fingerprint, made_id) VALUES (?, ?, ?, ?)",
                        {scope, request_id, fingerprint, made_id});
}

std::string MakePageToken(int64_t last_number, std::string_view list_and_filter) {
  return absl::StrFormat("%x-%08x", last_number, Crc32c(list_and_filter));
}

absl::StatusOr<int64_t> ParsePageToken(const PageRequest& page, std::string_view list_and_filter) {
  if (page.token.empty()) return std::numeric_limits<int64_t>::max();
  const std::vector<std::string> parts = absl::StrSplit(page.token, '-');
  int64_t number = 0;
  if (parts.size() != 2 || !absl::SimpleHexAtoi(parts[0], &number) ||
      page.token != MakePageToken(number, list_and_filter)) {
    return BadField("page_token", "page_token is not one of this list and filter; pass next_page_token unchanged");
  }
  return number;
}

absl::StatusOr<int> CheckPageSize(const PageRequest& page, const Limits& limits) {
  if (page.size < 1 || page.size > limits.max_page_size) {
    return BadField("page_size", absl::StrFormat("page_size = %d, must be 1 to %d", page.size, limits.max_page_size));
  }
  return page.size;
}

absl::Status CheckText(std::string_view field, std::string_view text, int max_bytes) {
  if (text.size() <= static_cast<size_t>(max_bytes)) return absl::OkStatus();
  return BadField(field,
                  absl::StrFormat("%s has %d bytes, must have at most %d", std::string(field), text.size(), max_bytes));
}

}  // namespace depthtween::server
