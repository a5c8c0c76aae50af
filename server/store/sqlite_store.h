// Store on one SQLite file: WAL, synchronous=FULL, BEGIN IMMEDIATE, one connection behind one mutex (competing writers
// would only starve one another).
#ifndef DEPTHTWEEN_SERVER_STORE_SQLITE_STORE_H_
#define DEPTHTWEEN_SERVER_STORE_SQLITE_STORE_H_

#include <memory>
#include <string>

#include "server/store/store.h"

namespace depthtween::server {

// Opens or creates the database and brings its schema up to date; before that, copies it to <file>.schema-<version>.
// FailedPrecondition if a newer version of the server made it; DataLoss if the file is not a database or is damaged.
// What is committed stands in a log first; `checkpoint_pages` of it are carried over into the file at a time, 0: as
// many as SQLite likes.
absl::StatusOr<std::unique_ptr<Store>> OpenSqliteStore(const std::string& file, const Limits& limits,
                                                       int checkpoint_pages = 0);

// The same to look at, without changing the file, which another process may be writing: methods that would write fail.
// FailedPrecondition if its schema is not this version's; NotFound if there is no such file.
absl::StatusOr<std::unique_ptr<Store>> OpenSqliteStoreToRead(const std::string& file);

// Reads the whole file, which another process may be writing: DataLoss, saying what is wrong, if it is damaged. Finds
// what contradicts itself, such as a row that its index does not know, and not every bit that is wrong.
absl::Status CheckSqliteFile(const std::string& file);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_SQLITE_STORE_H_
