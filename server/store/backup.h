// A copy of a data folder that is whole and belongs together, made while a server works in that folder.
//
// A backup is a data folder that a server could serve as it is, with one file more: backup.sha256 names every file of
// it with its SHA-256, in the form that `sha256sum --check` reads. What is copied: the database, in one state; of each
// recording the bytes that the database calls committed; all files of each job. Not copied: scratch, trash, quarantine.
//
// It needs no lock. Files that the database names never change, so only their deletion can come in between: what has
// gone when it is to be copied is looked up again in a newer state of the database, which then is the one that counts.
#ifndef DEPTHTWEEN_SERVER_STORE_BACKUP_H_
#define DEPTHTWEEN_SERVER_STORE_BACKUP_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/base/status.h"

namespace depthtween::server {

struct CopyProgress {
  int64_t files = 0;  // done, of how many
  int64_t files_total = 0;
  int64_t bytes = 0;
  int64_t bytes_total = 0;
};
using OnCopied = std::function<void(const CopyProgress&)>;

struct BackupOptions {
  // An earlier backup on the same file system, or empty. What has not changed since gets a second name there instead of
  // a copy (a hard link). It is not read again, so damage to it is not noticed here.
  std::string link_unchanged_from;
  OnCopied on_copied;  // after each file; may be empty
};

struct BackupSummary {
  int64_t files = 0;  // but for the list of them
  int64_t bytes = 0;
  int64_t linked_files = 0;  // of them, shared with the earlier backup
  int sequences = 0;
  int jobs = 0;
  int database_states = 0;  // how often the database was copied before files and database belonged together
  // One line for each file that the database names and that the data folder does not have, or has otherwise.
  std::vector<std::string> faults;
};

// Makes the folder `to`, which must not exist yet; when this returns OK it is durable. Until then it is called
// `to`.partial, so that what an interrupted call leaves is never taken for a backup. Changes nothing in `data_dir`.
// AlreadyExists if `to` or `to`.partial is there; FailedPrecondition if `data_dir` is no data folder or has no
// database; ResourceExhausted if the disk has no room for it; DataLoss if the database is damaged; Aborted if so much
// is deleted meanwhile that files and database never belong together.
absl::StatusOr<BackupSummary> MakeBackup(const std::string& data_dir, const std::string& to,
                                         const BackupOptions& options = {});

struct RestoreSummary {
  int64_t files = 0;
  int64_t bytes = 0;
  std::string folder_id;  // as before: the restored folder stands for the one that was backed up
};

// Copies the backup `from` to the folder `data_dir`, which must be missing or empty, and checks every byte against the
// list on the way. The folder is marked as a data folder last, so that no server takes a half of it; after an error
// what was written is removed. DataLoss, naming the file, if one is missing or has changed; FailedPrecondition if
// `from` is no backup or `data_dir` is not empty; ResourceExhausted if the disk has no room for it.
absl::StatusOr<RestoreSummary> RestoreBackup(const std::string& from, const std::string& data_dir,
                                             const OnCopied& on_copied = nullptr);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_BACKUP_H_
