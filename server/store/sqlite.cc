#include "server/store/sqlite.h"

#include <unistd.h>

#include <cerrno>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_format.h"
#include "server/store/error_info.h"
#include "server/store/files.h"

namespace depthtween::server {
namespace {

// How long a statement waits for a lock that another process holds, such as a backup or an operator's shell.
constexpr int kLockPatienceMs = 5000;

}  // namespace

int SqlValue::BindTo(sqlite3_stmt* statement, int position) const {
  struct Binder {
    sqlite3_stmt* statement;
    int position;
    int operator()(std::nullptr_t) const { return sqlite3_bind_null(statement, position); }
    int operator()(int64_t value) const { return sqlite3_bind_int64(statement, position, value); }
    int operator()(double value) const { return sqlite3_bind_double(statement, position, value); }
    int operator()(const std::string& text) const {
      return sqlite3_bind_text64(statement, position, text.data(), text.size(), SQLITE_TRANSIENT, SQLITE_UTF8);
    }
    int operator()(const Blob& blob) const {
      return sqlite3_bind_blob64(statement, position, blob.bytes.data(), blob.bytes.size(), SQLITE_TRANSIENT);
    }
  };
  return std::visit(Binder{statement, position}, value_);
}

std::string SqlRow::Text(int column) const {
  const void* data = sqlite3_column_blob(statement_, column);
  const int size = sqlite3_column_bytes(statement_, column);
  return data == nullptr ? std::string() : std::string(static_cast<const char*>(data), static_cast<size_t>(size));
}

absl::StatusOr<std::unique_ptr<Database>> Database::Open(const std::string& file, int checkpoint_pages) {
  sqlite3* connection = nullptr;
  const int code =
      sqlite3_open_v2(file.c_str(), &connection,
                      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_NOFOLLOW, nullptr);
  std::unique_ptr<Database> database(new Database(connection));
  if (code != SQLITE_OK) return WithContext(database->Error("open"), file);
  sqlite3_extended_result_codes(connection, 1);
  sqlite3_busy_timeout(connection, kLockPatienceMs);
  if (checkpoint_pages > 0) sqlite3_wal_autocheckpoint(connection, checkpoint_pages);
  // The log's files stay when the database is closed: on a full disk there would be no space to make them again.
  int keep_log = 1;
  sqlite3_file_control(connection, "main", SQLITE_FCNTL_PERSIST_WAL, &keep_log);
  for (const char* pragma : {"PRAGMA journal_mode = WAL", "PRAGMA synchronous = FULL", "PRAGMA foreign_keys = ON",
                             "PRAGMA trusted_schema = OFF"}) {
    RETURN_IF_ERROR(WithContext(database->Run(pragma), file));
  }
  return database;
}

absl::StatusOr<std::unique_ptr<Database>> Database::OpenToRead(const std::string& file) {
  if (access(file.c_str(), F_OK) != 0) return ErrnoStatus(errno, "open " + file);
  sqlite3* connection = nullptr;
  const int code = sqlite3_open_v2(file.c_str(), &connection,
                                   SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_NOFOLLOW, nullptr);
  std::unique_ptr<Database> database(new Database(connection));
  if (code != SQLITE_OK) return WithContext(database->Error("open"), file);
  sqlite3_extended_result_codes(connection, 1);
  sqlite3_busy_timeout(connection, kLockPatienceMs);
  RETURN_IF_ERROR(WithContext(database->Run("PRAGMA trusted_schema = OFF"), file));
  return database;
}

absl::Status Database::Run(const char* sql, const std::vector<SqlValue>& values,
                           const std::function<void(const SqlRow&)>& on_row) {
  auto found = statements_.find(std::string_view(sql));
  if (found == statements_.end()) {
    sqlite3_stmt* statement = nullptr;
    const int code = sqlite3_prepare_v3(connection_.get(), sql, -1, SQLITE_PREPARE_PERSISTENT, &statement, nullptr);
    if (code != SQLITE_OK) {
      const absl::Status error = Error(sql);
      // Our statements suit our schema: what is stored of it is not what was.
      return (code & 0xFF) == SQLITE_ERROR ? Damage(std::string(error.message())) : error;
    }
    found = statements_.emplace(sql, std::unique_ptr<sqlite3_stmt, Finalize>(statement)).first;
  }
  sqlite3_stmt* const statement = found->second.get();
  const absl::Cleanup reset = [statement] {
    sqlite3_reset(statement);
    sqlite3_clear_bindings(statement);
  };
  for (size_t i = 0; i < values.size(); ++i) {
    if (values[i].BindTo(statement, static_cast<int>(i) + 1) != SQLITE_OK) return Error(sql);
  }
  int code;
  while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
    if (on_row) on_row(SqlRow(statement));
  }
  return code == SQLITE_DONE ? absl::OkStatus() : Error(sql);
}

absl::StatusOr<std::optional<int64_t>> Database::Number(const char* sql, const std::vector<SqlValue>& values) {
  std::optional<int64_t> number;
  RETURN_IF_ERROR(Run(sql, values, [&number](const SqlRow& row) {
    if (!number && !row.IsNull(0)) number = row.Int64(0);
  }));
  return number;
}

absl::Status Database::RunScript(const std::string& sql) {
  return sqlite3_exec(connection_.get(), sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK ? absl::OkStatus()
                                                                                              : Error("schema");
}

absl::StatusOr<int64_t> Database::SchemaVersion() {
  ASSIGN_OR_RETURN(const std::optional<int64_t> version, Number("PRAGMA user_version"));
  return version.value_or(0);
}

absl::Status Database::CopyTo(const std::string& file) {
  if (unlink(file.c_str()) != 0 && errno != ENOENT) return ErrnoStatus(errno, "replace " + file);
  RETURN_IF_ERROR(WithContext(Run("VACUUM INTO ?", {file}), "copy the database to " + file));
  RETURN_IF_ERROR(SyncFile(file));
  return SyncFolder(file.substr(0, file.rfind('/') + 1) + ".");
}

absl::Status Database::Migrate(const std::vector<std::string>& steps) {
  ASSIGN_OR_RETURN(const int64_t seen, SchemaVersion());
  if (seen == static_cast<int64_t>(steps.size())) return absl::OkStatus();
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const int64_t version, SchemaVersion());
    if (version > static_cast<int64_t>(steps.size())) {
      return absl::FailedPreconditionError(
          absl::StrFormat("the database has schema %d, this server knows %d: a newer version wrote it, run that one",
                          version, steps.size()));
    }
    for (size_t step = static_cast<size_t>(version); step < steps.size(); ++step) {
      RETURN_IF_ERROR(RunScript(steps[step]));
    }
    return RunScript(absl::StrCat("PRAGMA user_version = ", steps.size()));
  });
}

void Database::RollBack() {
  // SQLite has rolled back by itself after some errors, such as a full disk; a second rollback would be an error.
  if (sqlite3_get_autocommit(connection_.get()) == 0) Run("ROLLBACK").IgnoreError();
}

absl::Status Database::Damage(const std::string& message) {
  damage_.Update(absl::DataLossError(message));
  return absl::DataLossError(message);
}

absl::Status Database::Error(std::string_view doing) {
  const int code = sqlite3_extended_errcode(connection_.get());
  const int error_number = sqlite3_system_errno(connection_.get());
  const std::string message = absl::StrCat("database: ", sqlite3_errmsg(connection_.get()), " (",
                                           absl::string_view(doing.data(), doing.size()), ")");
  const bool out_of_room = error_number == ENOSPC || error_number == EDQUOT || error_number == EFBIG;
  switch (code & 0xFF) {
    case SQLITE_FULL:
      return DiskFull(message);
    case SQLITE_IOERR:
    case SQLITE_CANTOPEN:  // also when there is no room for the name of a log
      if (error_number == EMFILE || error_number == ENFILE) return absl::UnavailableError(message);
      return out_of_room ? DiskFull(message) : absl::InternalError(message);
    case SQLITE_BUSY:
      return ServerBusy(absl::StrCat("another process holds the database: ", message));
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return Damage(message);
    default:
      return absl::InternalError(message);
  }
}

}  // namespace depthtween::server
