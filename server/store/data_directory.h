// The folder that belongs to one server process, and where everything lies in it.
//
//   depthtween-data        marks the folder as a server's; holds the id that the store has too
//   depthtween.sqlite      the store
//   sequences/<id>/        files as uploaded, under their relative paths: a sequence folder
//   jobs/<id>/             options.json, constants.json; out/: the result folder, growing with finished intervals
//   tasks/<number>/        scratch of one attempt, which nobody else writes to
//   tasks/errand-<n>/      scratch of a call that is waited for
//   trash/                 deleted folders on their way out
//   quarantine/            recordings and jobs that the store has no record of, each under the time of its arrival
//   lock                   held as long as the process lives; holds its process id
//
// Threads: all methods may be called concurrently.
#ifndef DEPTHTWEEN_SERVER_STORE_DATA_DIRECTORY_H_
#define DEPTHTWEEN_SERVER_STORE_DATA_DIRECTORY_H_

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>

#include "absl/time/time.h"
#include "core/base/status.h"

namespace depthtween::server {

// The file that marks a data folder, and the one with its records.
inline constexpr char kFolderMarker[] = "depthtween-data";
inline constexpr char kDatabaseName[] = "depthtween.sqlite";

// The id in a folder's marker. NotFound if it has no marker; DataLoss if that cannot be read.
absl::StatusOr<std::string> ReadFolderId(const std::string& folder);

struct DataDirectoryOptions {
  absl::Duration keep_quarantine = absl::Hours(7 * 24);  // what lies there longer is deleted
};

class DataDirectory {
 public:
  // Makes the folder if it is missing, marks it if it is empty, makes the folders in it and takes the lock. Changes
  // nothing in a folder of somebody else: FailedPrecondition if it is not empty and has no marker, DataLoss if the
  // marker cannot be read. FailedPrecondition, naming the other process, if the lock is taken and stays so for a
  // second.
  static absl::StatusOr<std::unique_ptr<DataDirectory>> Open(const std::string& path,
                                                             const DataDirectoryOptions& options = {});
  ~DataDirectory();
  DataDirectory(const DataDirectory&) = delete;
  DataDirectory& operator=(const DataDirectory&) = delete;

  const std::string& path() const { return path_; }
  // Of the marker: the same as long as the folder lives, wherever it is moved.
  const std::string& id() const { return id_; }
  std::string DatabaseFile() const { return path_ + "/" + kDatabaseName; }
  std::string SequencesFolder() const { return path_ + "/sequences"; }
  std::string JobsFolder() const { return path_ + "/jobs"; }
  std::string QuarantineFolder() const { return path_ + "/quarantine"; }
  std::string TasksFolder() const { return path_ + "/tasks"; }
  std::string SequenceFolder(std::string_view id) const { return Join("/sequences/", id); }
  std::string JobFolder(std::string_view id) const { return Join("/jobs/", id); }
  std::string OutFolder(std::string_view job_id) const { return JobFolder(job_id) + "/out"; }
  std::string TaskFolder(int64_t number) const { return Join("/tasks/", std::to_string(number)); }

  // What the disk under the folder has left for this process.
  absl::StatusOr<int64_t> FreeBytes() const;

  // The status for readers outside: paths in this folder are relative to it, "jobs/7/out/report.json", and the folder
  // itself is "the data folder".
  absl::Status WithoutPath(const absl::Status& status) const;

  // The folder is gone when this returns (renamed into trash/); its space is freed in the background. A folder that
  // does not exist is OK.
  absl::Status Discard(const std::string& folder);
  // Moves a folder into quarantine/ as <time>-<name>, where it stays for options.keep_quarantine. Returns where it is.
  absl::StatusOr<std::string> Quarantine(const std::string& folder, std::string_view name);

 private:
  DataDirectory(std::string path, std::string id, int lock_fd, const DataDirectoryOptions& options);
  std::string Join(std::string_view kind, std::string_view id) const;
  // The sweeper: empties the trash whenever something was thrown into it, and looks after the quarantine now and then.
  void Sweep(const std::stop_token& stop);
  void EmptyTrash(const std::stop_token& stop);
  void ExpireQuarantine(const std::stop_token& stop);

  const std::string path_;
  const std::string id_;
  const DataDirectoryOptions options_;
  const int lock_fd_;
  std::atomic<int64_t> trash_count_{0};
  std::mutex mutex_;
  std::condition_variable_any trash_changed_;
  bool trash_full_ = true;  // guarded by mutex_; true at first: an earlier process may have left some
  std::jthread sweeper_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_DATA_DIRECTORY_H_
