// A thin owner of SQLite's C API: one connection, its prepared statements, transactions that roll back by themselves.
//
// Errors: ResourceExhausted (DISK_FULL) when the disk is full, (SERVER_BUSY) when another process holds a lock for five
// seconds; DataLoss when the file is damaged or no database;
// Internal otherwise. Threads: one at a time.
#ifndef DEPTHTWEEN_SERVER_STORE_SQLITE_H_
#define DEPTHTWEEN_SERVER_STORE_SQLITE_H_

#include <sqlite3.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/status.h"

namespace depthtween::server {

// A value for a "?" of a statement. Text and blobs are copied.
class SqlValue {
 public:
  struct Blob {
    std::string bytes;
  };
  SqlValue(std::nullptr_t) {}  // NOLINT(google-explicit-constructor)
  template <typename T, std::enable_if_t<std::is_integral_v<T> || std::is_enum_v<T>, int> = 0>
  SqlValue(T value) : value_(static_cast<int64_t>(value)) {}      // NOLINT(google-explicit-constructor)
  SqlValue(double value) : value_(value) {}                       // NOLINT(google-explicit-constructor)
  SqlValue(std::string_view text) : value_(std::string(text)) {}  // NOLINT(google-explicit-constructor)
  SqlValue(const std::string& text) : value_(text) {}             // NOLINT(google-explicit-constructor)
  SqlValue(const char* text) : value_(std::string(text)) {}       // NOLINT(google-explicit-constructor)
  SqlValue(Blob blob) : value_(std::move(blob)) {}                // NOLINT(google-explicit-constructor)

  int BindTo(sqlite3_stmt* statement, int position) const;

 private:
  std::variant<std::nullptr_t, int64_t, double, std::string, Blob> value_;
};

// The row a statement stands on; valid during the callback that gets it. Columns count from 0.
class SqlRow {
 public:
  explicit SqlRow(sqlite3_stmt* statement) : statement_(statement) {}
  bool IsNull(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }
  int64_t Int64(int column) const { return sqlite3_column_int64(statement_, column); }
  int Int(int column) const { return static_cast<int>(Int64(column)); }
  double Real(int column) const { return sqlite3_column_double(statement_, column); }
  // Text or blob.
  std::string Text(int column) const;

 private:
  sqlite3_stmt* statement_;
};

class Database {
 public:
  // `checkpoint_pages` of the log are carried over into the file at a time; 0: as many as SQLite likes.
  static absl::StatusOr<std::unique_ptr<Database>> Open(const std::string& file, int checkpoint_pages = 0);
  // To look at a database that another process may be writing, without changing it. NotFound if there is none.
  static absl::StatusOr<std::unique_ptr<Database>> OpenToRead(const std::string& file);

  // Runs one statement; `on_row` gets every row it yields. Statements are prepared once and kept.
  absl::Status Run(const char* sql, const std::vector<SqlValue>& values = {},
                   const std::function<void(const SqlRow&)>& on_row = nullptr);
  // The first column of the first row, as a number; nullopt if there is no row or it is NULL.
  absl::StatusOr<std::optional<int64_t>> Number(const char* sql, const std::vector<SqlValue>& values = {});
  // Runs a script of several statements.
  absl::Status RunScript(const std::string& sql);
  // Migrates the file: runs those of `steps` that it has not seen, in one transaction. Steps are only ever appended.
  // Writes nothing if it has seen all, so that a server starts on a full disk. FailedPrecondition if it has seen more
  // than there are: a newer version wrote it.
  absl::Status Migrate(const std::vector<std::string>& steps);
  // How many steps it has seen; 0: it is new.
  absl::StatusOr<int64_t> SchemaVersion();
  // Writes a consistent copy, durable, over what is at `file`. Not inside a transaction.
  absl::Status CopyTo(const std::string& file);

  // The first DataLoss that a statement has met; OK: none has.
  const absl::Status& damage() const { return damage_; }

  int64_t ChangedRows() const { return sqlite3_changes64(connection_.get()); }
  int64_t LastInsertedRow() const { return sqlite3_last_insert_rowid(connection_.get()); }

  // Calls `body`, which returns a Status or StatusOr, between BEGIN IMMEDIATE and COMMIT; rolls back when it fails.
  template <typename Body>
  auto Transact(const Body& body) -> decltype(body()) {
    return Between("BEGIN IMMEDIATE", body);
  }
  // The same for a body that only reads: it sees one state of the file and needs no lock that others may hold.
  template <typename Body>
  auto Read(const Body& body) -> decltype(body()) {
    return Between("BEGIN", body);
  }

 private:
  struct Close {
    void operator()(sqlite3* connection) const { sqlite3_close(connection); }
  };
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  explicit Database(sqlite3* connection) : connection_(connection) {}
  template <typename Body>
  auto Between(const char* begin, const Body& body) -> decltype(body()) {
    RETURN_IF_ERROR(Run(begin));
    auto result = body();
    if (!result.ok()) {
      RollBack();
      return result;
    }
    if (absl::Status status = Run("COMMIT"); !status.ok()) {
      RollBack();
      return status;
    }
    return result;
  }
  absl::Status Error(std::string_view doing);
  absl::Status Damage(const std::string& message);
  void RollBack();

  std::unique_ptr<sqlite3, Close> connection_;
  absl::Status damage_;
  std::map<std::string, std::unique_ptr<sqlite3_stmt, Finalize>, std::less<>> statements_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_SQLITE_H_
